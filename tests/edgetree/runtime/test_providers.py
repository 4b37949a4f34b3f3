"""The requested provider is used, or there is an error or a warning."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from numpy.typing import NDArray

from basetree.errors import InputError
from edgetree import sample_frames
from edgetree.model_file.manifest import Manifest
from edgetree.runtime import TreeDetector, default_model
from edgetree.runtime.ort_session import placement_of
from edgetree.runtime.providers import PROVIDERS, Provider, SessionSettings, installed_providers
from edgetree.runtime.session import OrtSession

ModelWriter = Callable[..., Path]


@pytest.fixture
def model(rgb_manifest: Manifest, write_model: ModelWriter) -> Path:
    return write_model(rgb_manifest, "trees.onnx")


@pytest.fixture
def listed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let onnxruntime list CUDA but fail to start it, like a GPU build without a driver."""
    names = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: names)


silent_fallback = pytest.mark.filterwarnings("ignore:Specified provider")


def test_the_cpu_is_the_default(model: Path) -> None:
    assert OrtSession(model).provider == "cpu"
    assert "cpu" in installed_providers()


def test_the_error_for_a_missing_provider_lists_the_installed_ones(model: Path) -> None:
    message = (
        r"provider 'openvino' is not in the installed onnxruntime: expected one of cpu.*;"
        " it comes with onnxruntime-openvino"
    )
    with pytest.raises(InputError, match=message):
        TreeDetector.load(model, provider="openvino")


@silent_fallback
@pytest.mark.usefixtures("listed")
def test_a_provider_that_does_not_start_is_an_error(model: Path) -> None:
    message = (
        r"provider 'cuda' cannot be used for model .*trees\.onnx \(onnxruntime did not load it"
    )
    with pytest.raises(InputError, match=message):
        TreeDetector.load(model, provider="cuda")


@silent_fallback
@pytest.mark.usefixtures("listed")
@pytest.mark.parametrize("settings", [{"provider": "cuda", "strict": False}, {"provider": "auto"}])
def test_the_cpu_is_used_with_a_warning(
    model: Path, settings: dict[str, object], caplog: pytest.LogCaptureFixture
) -> None:
    detector = TreeDetector.load(model, **settings)  # type: ignore[arg-type]
    assert detector.session.provider == "cpu"
    warnings = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert [record.getMessage().partition(" (")[0] for record in warnings] == [
        "provider 'cuda' cannot be used"
    ]


def test_a_missing_provider_that_is_not_strict_gives_one_warning(
    model: Path, caplog: pytest.LogCaptureFixture
) -> None:
    session = OrtSession(model, SessionSettings("coreml", strict=False))
    assert session.provider == "cpu"
    assert caplog.messages == ["provider 'coreml' is not installed: using the CPU"]


def test_auto_without_an_accelerator_gives_no_warning(
    model: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    names = ["CPUExecutionProvider"]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: names)
    assert OrtSession(model, SessionSettings("auto")).provider == "cpu"
    assert caplog.messages == []


@pytest.mark.skipif(
    "AzureExecutionProvider" not in onnxruntime.get_available_providers(),
    reason="this onnxruntime has no provider that takes no nodes",
)
def test_a_provider_that_runs_no_part_of_the_graph_is_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # This provider starts on every machine and supports none of our operators.
    monkeypatch.setitem(PROVIDERS, "cuda", Provider("cuda", "AzureExecutionProvider", "x"))
    with pytest.raises(InputError, match=r"'cuda' cannot be used .*runs no part of the graph"):
        OrtSession(default_model("rgb"), SessionSettings("cuda"))


def test_placement_counts_nodes_by_provider_and_operator() -> None:
    class Node:
        def __init__(self, op_type: str) -> None:
            self.op_type = op_type

    class Part:
        def __init__(self, ep_name: str, *operators: str) -> None:
            self.ep_name = ep_name
            self.get_nodes = lambda: [Node(operator) for operator in operators]

    class Session:
        def get_provider_graph_assignment_info(self) -> list[Part]:
            return [
                Part("TensorrtExecutionProvider", "Conv", "Relu", "Conv"),
                Part("CPUExecutionProvider", "NonMaxSuppression"),
                Part("OtherExecutionProvider", "Cast"),
            ]

    assert placement_of(Session(), PROVIDERS["tensorrt"]) == {
        "tensorrt": {"Conv": 2, "Relu": 1},
        "cpu": {"NonMaxSuppression": 1},
        "OtherExecutionProvider": {"Cast": 1},
    }
    assert placement_of(object(), PROVIDERS["tensorrt"]) == {}


@pytest.mark.parametrize("cache", [True, False])
def test_tensorrt_gets_its_exclusions_and_its_cache_folder(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cache: bool
) -> None:
    seen: dict[str, object] = {}

    def opened(path: str, **asked: object) -> None:
        seen.update(asked)
        raise RuntimeError("stop here")

    severities: list[int] = []
    monkeypatch.setattr(onnxruntime, "set_default_logger_severity", severities.append)
    names = [f"{name}ExecutionProvider" for name in ("Tensorrt", "CUDA", "CPU")]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: names)
    monkeypatch.setattr(onnxruntime, "InferenceSession", opened)
    folder = tmp_path / "made" / "engines" if cache else None
    with pytest.raises(InputError, match=r"'tensorrt' cannot be used .*\(stop here\)"):
        OrtSession(model, SessionSettings("tensorrt", cache_folder=folder))
    providers = seen["providers"]
    assert isinstance(providers, list)
    assert [name for name, _ in providers] == names
    options = providers[0][1]
    assert options["trt_op_types_to_exclude"] == "NonMaxSuppression,NonZero,RoiAlign"
    assert options.get("trt_engine_cache_path") == (None if folder is None else str(folder))
    assert ("trt_engine_cache_enable" in options) == cache
    assert folder is None or folder.is_dir()
    assert seen["enable_fallback"] == 0
    assert severities == [3]  # warnings of kernels do not reach users


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"provider": "gpu"}, "provider is 'gpu': expected one of auto, cpu, cuda, tensorrt"),
        ({"threads": 0}, "threads is 0: expected 1 to 1024"),
        ({"cache_folder": Path("x")}, r"cache folder is x, but provider 'cpu' has no cache"),
    ],
)
def test_settings_out_of_range_are_named(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SessionSettings(**settings)  # type: ignore[arg-type]


@pytest.mark.usefixtures("listed")
def test_a_cache_folder_that_cannot_be_created_is_named(model: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    settings = SessionSettings("auto", cache_folder=tmp_path / "file" / "cache")
    with pytest.raises(
        InputError, match=r"cache folder .*cache cannot be created \(.*\): expected"
    ):
        OrtSession(model, settings)


def test_bound_inputs_give_the_same_outputs(monkeypatch: pytest.MonkeyPatch) -> None:
    path = default_model("depth")
    rng = np.random.default_rng(0)
    images: list[NDArray[np.uint8]] = [
        rng.integers(0, 255, (1, 384, 640), np.uint8) for _ in range(2)
    ]
    plain = OrtSession(path, SessionSettings(threads=1))
    bound_to_memory = Provider("cpu", "CPUExecutionProvider", "onnxruntime", io_device="cpu")
    monkeypatch.setitem(PROVIDERS, "cpu", bound_to_memory)
    bound = OrtSession(path, SessionSettings(threads=1))
    for image in images:
        views = (image, image[:, :, ::-1][:, :, ::-1])
        expected = plain.run({"image": image})
        for view in views:
            for name, values in bound.run({"image": view}).items():
                np.testing.assert_array_equal(values, expected[name])


@pytest.mark.parametrize(
    ("options", "code", "line"),
    [
        (["--provider", "openvino"], 2, "edgetree: provider 'openvino' is not in the installed"),
        (["--provider", "gpu"], 2, "edgetree: provider is 'gpu': expected one of auto, cpu"),
        (["--provider-cache", "x"], 2, "edgetree: cache folder is x, but provider 'cpu' has no"),
        (
            ["--provider", "openvino", "--no-strict"],
            0,
            "provider 'openvino' is not installed: using the CPU",
        ),
    ],
)
def test_the_command_line_takes_a_provider(options: list[str], code: int, line: str) -> None:
    image = sample_frames()[0].image_path
    done = subprocess.run(
        [sys.executable, "-m", "edgetree", "run", image, "--json", *options],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code
    assert done.stderr.startswith(line)
    assert code == 0 or done.stderr.count("\n") == 1
    assert code == 2 or json.loads(done.stdout)["model"]["provider"] == "cpu"
