"""Make the files that `export.py` times: torchvision's network, this project's R50 and its trunk.

The trunk is backbone and pyramid.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from eager import torchvision_network
from numpy.typing import NDArray

from basetree.files.writing import replacing
from edgetree.export import ExportSettings
from edgetree.export.build import trace
from edgetree.export.frames import frames_sha256, sample_inputs
from edgetree.export.models import UNTRAINED, load_model, untrained_model, with_settings
from edgetree.export.quantise import quantise
from edgetree.export.quiet import quiet
from perceptree.data import FrameStore, read_split
from perceptree.models import TreeRCNN

SIDE_PX, ROWS, ALL_PROPOSALS = 800, 20, 1000


def note(text: str) -> None:
    """Print a progress message to the terminal."""
    sys.stderr.write(text + "\n")


def reuse_or_make(path: Path, make: Callable[[Path], object]) -> Path:
    """Return the file, and make it if it does not exist."""
    if not path.is_file():
        note(f"making {path.name}")
        with tempfile.TemporaryDirectory() as folder, quiet():
            made = Path(folder) / path.name
            make(made)
            with replacing(path) as file:
                file.write(made.read_bytes())
    return path


def make_torchvision(path: Path) -> None:
    """Export torchvision's network by torchvision's exporter, for one float RGB frame."""
    torch.manual_seed(0)
    network = torchvision_network()
    network.transform.min_size, network.transform.max_size = (SIDE_PX,), SIDE_PX
    frame = torch.rand(3, SIDE_PX, SIDE_PX)
    torch.onnx.export(
        network, ([frame],), path, dynamo=False, opset_version=17, input_names=["image"]
    )


def make_trunk(model: TreeRCNN, path: Path) -> None:
    """Export only backbone and pyramid, for a normalised float frame."""

    class Trunk(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.backbone, self.pyramid = model.backbone, model.pyramid

        def forward(self, image: torch.Tensor) -> tuple[torch.Tensor, ...]:
            return tuple(self.pyramid(self.backbone(image)))

    frame = torch.zeros(1, model.spec.channels, SIDE_PX, SIDE_PX)
    program = torch.onnx.export(
        Trunk().eval(), (frame,), dynamo=True, input_names=["image"], verbose=False
    )
    assert program is not None
    path.write_bytes(program.model_proto.SerializeToString())


def our_model(checkpoint: Path | None) -> tuple[TreeRCNN, str, str]:
    """The R50 with all proposals, the name of its training data, and a name of its weights."""
    settings = ExportSettings(SIDE_PX, SIDE_PX, max_detections=ROWS, proposals=ALL_PROPOSALS)
    if checkpoint is None:
        return untrained_model("r50", "rgb", settings), UNTRAINED, f"r50-{UNTRAINED}"
    model, data, _ = load_model(checkpoint)
    digest = hashlib.sha256(checkpoint.read_bytes()).hexdigest()[:8]
    return with_settings(model, settings), data, f"{model.spec.name}-{digest}"


def calibration_frames(model: TreeRCNN, data: Path | None, most: int) -> NDArray[np.uint8]:
    """Evenly spaced frames of the train split; without a dataset, the package's samples."""
    if data is None:
        return sample_inputs(model.spec)[:most]
    store = FrameStore(spread(read_split(data, "train"), most), model.spec)
    return np.stack([store[index].image for index in range(len(store))])


def spread(items: Sequence[Any], most: int) -> list[Any]:
    """At most ``count`` of the items, evenly spaced."""
    count = min(most, len(items))
    return [items[index * len(items) // count] for index in range(count)]


def build(
    model: TreeRCNN, weights: str, shown: NDArray[np.uint8], proposals: int, folder: Path
) -> dict[str, Path]:
    """Make all files at 800x800; returns them by name."""
    fewer = with_settings(model, ExportSettings(proposals=proposals))

    def traced(network: TreeRCNN) -> Callable[[Path], object]:
        return lambda path: path.write_bytes(trace(network, batch=1).SerializeToString())

    def quantised(path: Path) -> None:
        graph = quantise(trace(fewer, batch=1, quantised=True), shown)
        path.write_bytes(graph.SerializeToString())

    frames = frames_sha256(shown)[:8]
    wanted: dict[str, tuple[str, Callable[[Path], object]]] = {
        "torchvision": ("torchvision", make_torchvision),
        f"float32-{ALL_PROPOSALS}": (f"{weights}-float32-{ALL_PROPOSALS}", traced(model)),
        f"float32-{proposals}": (f"{weights}-float32-{proposals}", traced(fewer)),
        f"int8-{proposals}": (f"{weights}-int8-{proposals}-{frames}", quantised),
        "trunk": (f"{weights}-trunk", lambda path: make_trunk(model, path)),
    }
    return {
        name: reuse_or_make(folder / f"{stem}.onnx", make) for name, (stem, make) in wanted.items()
    }
