"""OrtSession and FakeSession give the same outputs; errors name the file."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from basetree.errors import InputError, MissingPackage
from edgetree.errors import ModelFileError
from edgetree.model_file.manifest import METADATA_KEY, Manifest
from edgetree.model_file.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.runtime.providers import SessionSettings
from edgetree.runtime.session import FakeSession, InferenceSession, OrtSession, usable_cores


def test_both_sessions_give_the_same_outputs(
    rgb_manifest: Manifest,
    two_trees: dict[str, NDArray[np.float32]],
    write_model: Callable[..., Path],
) -> None:
    real: InferenceSession = OrtSession(write_model(rgb_manifest))
    fake: InferenceSession = FakeSession.with_trees(rgb_manifest, **two_trees)
    assert real.metadata[METADATA_KEY] == fake.metadata[METADATA_KEY]
    assert real.input_shapes == fake.input_shapes == {"image": ("batch", 384, 640, 3)}
    assert list(real.output_shapes) == list(fake.output_shapes)
    image = {"image": np.zeros((1, 384, 640, 3), np.uint8)}
    answers = real.run(image)
    for name, value in fake.run(image).items():
        np.testing.assert_array_equal(answers[name], value)
        assert answers[name].dtype == value.dtype


def test_threads_are_the_usable_cores_unless_given(
    rgb_manifest: Manifest, write_model: Callable[..., Path]
) -> None:
    path = write_model(rgb_manifest)
    assert OrtSession(path).threads == usable_cores()
    assert OrtSession(path, SessionSettings(threads=1, spinning=True)).threads == 1
    with pytest.raises(InputError, match="threads is 0: expected 1 to 1024"):
        SessionSettings(threads=0)


def test_idle_threads_do_not_spin_by_default(
    rgb_manifest: Manifest, write_model: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    import onnxruntime

    seen: dict[str, str] = {}

    class Options(onnxruntime.SessionOptions):  # type: ignore[misc]
        def add_session_config_entry(self, key: str, value: str) -> None:
            seen[key] = value
            super().add_session_config_entry(key, value)

    monkeypatch.setattr(onnxruntime, "SessionOptions", Options)
    path = write_model(rgb_manifest)
    OrtSession(path)
    assert seen["session.intra_op.allow_spinning"] == "0"
    OrtSession(path, SessionSettings(spinning=True))
    assert seen["session.intra_op.allow_spinning"] == "1"


@pytest.mark.parametrize("content", [b"", b"not a model\n" * 50, b"\x89PNG\r\n\x1a\n" + b"\0" * 99])
def test_a_file_that_is_not_an_onnx_model_is_rejected(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "trees.onnx"
    path.write_bytes(content)
    with pytest.raises(ModelFileError, match=r"trees\.onnx is not an ONNX model .*: expected"):
        OrtSession(path)


def test_a_missing_model_is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match=r"none\.onnx does not exist: expected an \.onnx file"):
        OrtSession(tmp_path / "none.onnx")
    with pytest.raises(ModelFileError, match="is a folder: expected"):
        OrtSession(tmp_path)


def test_without_onnxruntime_the_error_has_the_pip_command(
    rgb_manifest: Manifest, write_model: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_model(rgb_manifest)
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingPackage, match=r"\.\[cpu\].*\.\[gpu\]") as caught:
        OrtSession(path)
    assert caught.value.exit_code == 2


def test_a_failed_run_is_an_error_and_the_session_stays_usable(
    rgb_manifest: Manifest, write_model: Callable[..., Path]
) -> None:
    session = OrtSession(write_model(rgb_manifest, "trees.onnx"))
    with pytest.raises(ModelFileError, match=r"trees\.onnx failed to run on 'cpu' \(") as caught:
        session.run({"image": np.zeros((1, 384, 640), np.uint8)})
    assert "\n" not in str(caught.value)
    assert len(session.run({"image": np.zeros((1, 384, 640, 3), np.uint8)})) == 6


def test_a_graph_that_needs_too_much_memory_is_an_error(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "greedy.onnx"
    column, row = TensorType("float32", ("n", 1)), TensorType("float32", (1, "n"))
    path.write_bytes(
        onnx_bytes(
            [Node("MatMul", ("column", "row"), ("y",))],
            inputs={"column": column, "row": row},
            outputs={"y": TensorType("float32", ("n", "n"))},
            constants={},
        )
    )
    session = OrtSession(path, SessionSettings(threads=1))
    message = r"greedy\.onnx failed to run on 'cpu' \(Failed to allocate memory"
    many, two = np.ones(10**7, np.float32), np.ones(2, np.float32)
    with pytest.raises(ModelFileError, match=message):
        session.run({"column": many[:, None], "row": many[None]})
    assert session.run({"column": two[:, None], "row": two[None]})["y"].sum() == 4
    assert capfd.readouterr() == ("", "")
