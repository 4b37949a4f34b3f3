"""Starting weights of a training: published weights or those of a checkpoint."""

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
# Fields of the spec that must match for the weights to be valid, though no tensor shape shows it.
_MUST_MATCH = ("backbone", "modality", "mean", "std", "stride_in_1x1")


def describe_init(init: Init | None) -> dict[str, str]:
    """Describe starting weights.

    Args:
        init: The starting weights; None for random ones.

    Returns:
        Their ``name``, and for a file its ``sha256``.

    Raises:
        CheckpointError: If the file cannot be read.
    """
    if not isinstance(init, Path):
        return {"name": init or "random"}
    try:
        with init.open("rb") as file:
            return {"name": init.name, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}
    except OSError as error:
        raise CheckpointError(f"{init}: cannot be read ({error.strerror})") from error


def start_from(model: TreeRCNN, init: Init) -> None:
    """Load starting weights into a model.

    A checkpoint may have another input size than the model. A mask or keypoint head that only the
    checkpoint has is ignored; one that only the model has keeps its random weights.

    Args:
        model: The model to change.
        init: The starting weights.

    Raises:
        CheckpointError: If the weights cannot be read or downloaded, or do not match the model.
        SettingsError: If there are no such weights for the model's backbone.
    """
    if init == "imagenet":
        load_imagenet(model)
    elif init == "coco":
        load_coco(model)
    else:
        _load_file(model, Path(init))


def _load_file(model: TreeRCNN, path: Path) -> None:
    start, _ = load_checkpoint(path)
    for name in _MUST_MATCH:
        theirs, ours = getattr(start.spec, name), getattr(model.spec, name)
        if theirs != ours:
            raise CheckpointError(f"{path}: {name} is {theirs}, expected {ours} as in the model")
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
