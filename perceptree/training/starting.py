"""Where a training starts: at random weights, at a library's, or at those of a checkpoint."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Literal

from torch import Tensor

from perceptree.errors import CheckpointError
from perceptree.models import TreeRCNN, load_checkpoint
from perceptree.models.checkpoint import check_tensors
from perceptree.models.pretrained import load_coco, load_imagenet

Init = Literal["imagenet", "coco"] | Path
"""Starting weights: published ones by name, or a checkpoint of this project."""

_BRANCHES = ("mask_head", "keypoint_head")
# What the weights cannot be used without, though it shows in no tensor's shape.
_SAME = ("backbone", "modality", "mean", "std", "stride_in_1x1")


def describe_init(init: Init | None) -> dict[str, str]:
    """The starting weights' ``name``, and the ``sha256`` of a file.

    Raises CheckpointError for a file that cannot be read.
    """
    if not isinstance(init, Path):
        return {"name": init or "random"}
    try:
        with init.open("rb") as file:
            return {"name": init.name, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}
    except OSError as error:
        raise CheckpointError(f"{init}: cannot be read ({error.strerror})") from error


def start_from(model: TreeRCNN, init: Init) -> None:
    """Give ``model`` its starting weights.

    A file's input size may be another one. A mask or keypoint branch that only the file has is
    left out, one that only the model has stays random. Raises CheckpointError where the weights
    cannot be read, fetched or fitted, SettingsError where there are none for this model.
    """
    if init == "imagenet":
        load_imagenet(model)
    elif init == "coco":
        load_coco(model)
    else:
        _load_file(model, Path(init))


def _load_file(model: TreeRCNN, path: Path) -> None:
    start, _ = load_checkpoint(path)
    for name in _SAME:
        theirs, ours = getattr(start.spec, name), getattr(model.spec, name)
        if theirs != ours:
            raise CheckpointError(f"{path}: its {name} is {theirs}, expected the model's, {ours}")
    one_sided = {
        name
        for name in _BRANCHES
        if (getattr(start, name) is None) != (getattr(model, name) is None)
    }

    def shared(weights: dict[str, Tensor]) -> dict[str, Tensor]:
        return {name: t for name, t in weights.items() if name.split(".")[0] not in one_sided}

    own, found = model.state_dict(), shared(start.state_dict())
    check_tensors(path, shared(own), found)
    model.load_state_dict(own | found)
