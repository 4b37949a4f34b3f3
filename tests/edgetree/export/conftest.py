"""A small network with varied detections without training, and frames for it."""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import pytest
import torch
from narrow_networks import NARROW_PAPER
from numpy.typing import NDArray
from once import Once

from calib import write_depth
from edgetree.export import ExportReport, build, export_model
from edgetree.export.build import trace
from edgetree.model_file.manifest import METADATA_KEY
from perceptree.models import TreeRCNN, make_spec, save_checkpoint

HEIGHT, WIDTH = 96, 160
RECORD: dict[str, Any] = {
    "data": "random numbers",
    "pictures": {"lightness": [50.0, 190.5], "contrast": [20, 70]},
    "reach_m": 12,
}

BuildModel = Callable[..., TreeRCNN]
Change = Callable[[NDArray[Any]], NDArray[Any]]
Tamper = Callable[..., Path]
Trace = Callable[..., Any]


def random_model(modality: str = "rgb", preset: str = "edge-n", **changes: Any) -> TreeRCNN:
    """A model with random weights, scaled up in the last layers for clear peaks of the scores."""
    torch.manual_seed(1)
    is_light = preset.startswith("edge-")
    narrow = {"fpn_width": 32} if is_light else NARROW_PAPER | {"detections": 6}
    values: dict[str, Any] = {"height": HEIGHT, "width": WIDTH, **narrow, **changes}
    model = TreeRCNN(make_spec(preset, modality, **values))  # type: ignore[arg-type]
    for part in model.modules():
        if isinstance(part, torch.nn.BatchNorm2d):
            part.momentum = None  # use the mean over all batches
    with torch.no_grad():
        for layer in model.colour_lateral or ():
            torch.nn.init.normal_(layer.weight, std=0.1)
        for _ in range(3):  # statistics for the batch norms
            images = torch.randint(0, 256, (4, *input_shape(model)), dtype=torch.uint8)
            model.features(images)
        model.proposer.objectness.weight.mul_(100)
        model.box_head.score.weight.mul_(10)
        if model.keypoint_head is not None:
            model.keypoint_head.tower.up.weight.mul_(100)
        if model.mask_head is not None:
            model.mask_head.score.weight.mul_(20)
    return model.eval()


def input_shape(model: TreeRCNN) -> tuple[int, ...]:
    """Shape of one input image: (H, W, 3), (H, W) or (H, W, 4)."""
    return model.spec.image_shape


@pytest.fixture(scope="session")
def build_model() -> BuildModel:
    """The function `random_model`, which builds such a network."""
    return random_model


@pytest.fixture(scope="session")
def rgb_checkpoint(once: Once) -> Path:
    folder = once.folder(
        "export-rgb",
        lambda new: save_checkpoint(new / "rgb.safetensors", random_model("rgb"), RECORD),
    )
    return folder / "rgb.safetensors"


@pytest.fixture(scope="session")
def depth_checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("checkpoints") / "depth.safetensors"
    save_checkpoint(path, random_model("depth", masks=False), {"data": "random numbers"})
    return path


@pytest.fixture(scope="session")
def both_checkpoint(once: Once) -> Path:
    record = {**RECORD, "pictures": RECORD["pictures"] | {"median_m": [3.0, 9.0]}}
    folder = once.folder(
        "export-both",
        lambda new: save_checkpoint(new / "both.safetensors", random_model("both"), record),
    )
    return folder / "both.safetensors"


@pytest.fixture(scope="session")
def frame_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder like a dataset's, with images and depth larger than the input."""
    folder = tmp_path_factory.mktemp("frames")
    random = np.random.default_rng(3)
    (folder / "images").mkdir()
    (folder / "depth").mkdir()
    for number in range(6):
        coarse = random.integers(0, 256, (9, 16, 3), dtype=np.uint8)
        image = cv2.resize(coarse, (320, 180), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / "images" / f"{number:06d}.png"), image)
        depth_m = image[..., 0].astype(np.float32) / 20
        write_depth(folder / "depth" / f"{number:06d}.png", depth_m)
    return folder


@pytest.fixture(scope="session")
def traced(once: Once) -> Trace:
    """The function `edgetree.export.build.trace`, which traces each network once in a run."""

    def look_up(model: TreeRCNN, *settings: Any, **more: bool) -> Any:
        key = [f"{model.spec} {settings} {more}".encode()]
        key += [value.numpy().tobytes() for value in model.state_dict().values()]

        def make(folder: Path) -> None:
            onnx.save(trace(model, *settings, **more), folder / "traced.onnx")

        name = f"trace-{hashlib.sha256(b''.join(key)).hexdigest()[:20]}"
        return onnx.load(once.folder(name, make) / "traced.onnx")

    return look_up


@pytest.fixture
def shared_traces(traced: Trace, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exports take the trace of a network that another test has made."""
    monkeypatch.setattr(build, "trace", traced)


@pytest.fixture(scope="session")
def exported(rgb_checkpoint: Path, frame_folder: Path, traced: Trace, once: Once) -> ExportReport:
    """The RGB checkpoint, exported in float32."""

    def export(folder: Path) -> ExportReport:
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(build, "trace", traced)
            return export_model(rgb_checkpoint, folder / "rgb.onnx", data=frame_folder)

    report: ExportReport = once.value("export-float32", export)
    return report


@pytest.fixture
def tamper(tmp_path: Path) -> Tamper:
    """The function `tampered`, which changes weights and manifest of a model file."""

    def tampered(
        source: Path, changes: Mapping[str, Change] | None = None, /, **manifest: object
    ) -> Path:
        """A copy of a model file with other values.

        Args:
            source: the model file.
            changes: functions of the weights and biases whose names start with the keys.
            manifest: new values of the manifest.
        """
        proto = onnx.load(source)
        for start, change in (changes or {}).items():
            tensors = [
                tensor
                for tensor in proto.graph.initializer
                if tensor.name.startswith(start)
                and tensor.name.endswith(("weight", "bias", "weight_quantized"))
            ]
            assert tensors, start
            for tensor in tensors:
                values = onnx.numpy_helper.to_array(tensor)
                changed = change(values).astype(values.dtype)
                tensor.CopyFrom(onnx.numpy_helper.from_array(changed, tensor.name))
        stored = {entry.key: entry.value for entry in proto.metadata_props}
        about = json.loads(stored[METADATA_KEY]) | manifest
        onnx.helper.set_model_props(proto, {METADATA_KEY: json.dumps(about)})
        path = tmp_path / "tampered.onnx"
        onnx.save(proto, path)
        return path

    return tampered
