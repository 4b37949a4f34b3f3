"""Starting weights of a training: published weights or those of a checkpoint."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from torch import Tensor

from basetree.errors import SettingsError
from basetree.files.reading import file_sha256
from perceptree.errors import CheckpointError
from perceptree.models import TreeRCNN, load_checkpoint
from perceptree.models.branches import joined_spec, load_branches
from perceptree.models.checkpoint import check_tensors
from perceptree.models.packaged import PACKAGED_WEIGHTS
from perceptree.models.pretrained import load_coco, load_imagenet


@dataclass(frozen=True)
class Branches:
    """Starting weights of a network of both inputs, from two networks of one.

    Attributes:
        depth: Checkpoint of a network of depth; its pyramid and heads are taken, too.
        colour: Checkpoint of a network of colour, of which the backbone is taken.
    """

    depth: Path
    colour: Path


Init = Literal["imagenet", "coco"] | Path | Branches
"""Starting weights: published ones by name, a checkpoint of this project, or two of them."""

_BRANCHES = ("mask_head", "keypoint_head")
_BACKBONE, _LATERAL = ("backbone.", "colour_backbone."), "pyramid.lateral."
# Fields of the spec that must match for the weights to be valid, though no tensor shape shows it.
_MUST_MATCH = (
    *("backbone", "modality", "mean", "std", "stride_in_1x1"),
    *("colour_backbone", "colour_mean", "colour_std"),
    *("reduction", "colour_reduction"),
)


def files_of(init: Init | None) -> list[Path]:
    """The checkpoints that starting weights come from."""
    if isinstance(init, Branches):
        return [init.depth, init.colour]
    return [init] if isinstance(init, Path) else []


def describe_init(init: Init | None, backbone: str = "") -> dict[str, Any]:
    """Describe starting weights.

    Args:
        init: The starting weights; None for random ones.
        backbone: The model's backbone, which decides what `imagenet` stands for.

    Returns:
        Their `name`; for a file its `sha256`; for weights that a package carries also their
        `weights` and `licence`; for two files those of the second as `colour`.

    Raises:
        CheckpointError: If the file cannot be read.
    """
    if isinstance(init, Branches):
        return describe_init(init.depth) | {"colour": describe_init(init.colour)}
    if isinstance(init, Path):
        return {"name": init.name, "sha256": _sha256(init)}
    packaged = PACKAGED_WEIGHTS.get(backbone) if init == "imagenet" else None
    path = packaged.find() if packaged else None
    if packaged and path:
        known = {"weights": packaged.file, "licence": packaged.licence}
        return {"name": "imagenet", "sha256": _sha256(path)} | known
    return {"name": init or "random"}


def _sha256(path: Path) -> str:
    try:
        return file_sha256(path)
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read ({error.strerror})") from error


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
    if model.spec.modality == "both" and isinstance(init, str):
        raise SettingsError(
            f"the starting weights of a model of both inputs are {init}, expected checkpoints:"
            " --init of a depth model and --init-colour of an rgb model"
        )
    if init == "imagenet":
        load_imagenet(model)
    elif init == "coco":
        load_coco(model)
    elif isinstance(init, Branches):
        _load_branches(model, init)
    else:
        _load_file(model, init)


def _load_branches(model: TreeRCNN, init: Branches) -> None:
    depth, colour = (load_checkpoint(path)[0] for path in (init.depth, init.colour))
    factor = model.spec.colour_reduction
    start = TreeRCNN(joined_spec(depth.spec, colour.spec, model.spec.name, factor))
    load_branches(start, depth, colour)
    _load(model, start, init.depth)


def _load_file(model: TreeRCNN, path: Path) -> None:
    _load(model, load_checkpoint(path)[0], path)


def _load(model: TreeRCNN, start: TreeRCNN, path: Path) -> None:
    """Load the weights of a network, whose file an error names."""
    for name in _MUST_MATCH:
        theirs, ours = getattr(start.spec, name), getattr(model.spec, name)
        if theirs != ours:
            raise CheckpointError(f"{path}: {name} is {theirs}, expected {ours} as in the model")
    own, found = model.state_dict(), _shared(start.state_dict(), start, model)
    check_tensors(path, _shared(own, start, model), found)
    model.load_state_dict(own | found)


def load_heads(model: TreeRCNN, path: Path) -> None:
    """Load all but the backbones from a checkpoint.

    The pyramid's first convolutions keep their weights where the checkpoint's backbone has maps of
    another width. A mask or keypoint head is treated as by `start_from`.

    Args:
        model: The model to change.
        path: The checkpoint.

    Raises:
        CheckpointError: If the file cannot be read, or its pyramid or heads do not fit.
    """
    start, _ = load_checkpoint(path)
    own, found = (
        {
            name: value
            for name, value in _shared(network.state_dict(), start, model).items()
            if not name.startswith(_BACKBONE)
        }
        for network in (model, start)
    )
    other_width = {
        name
        for name in found
        if name.startswith(_LATERAL) and name in own and own[name].shape != found[name].shape
    }
    taken = {name: value for name, value in found.items() if name not in other_width}
    check_tensors(path, {n: v for n, v in own.items() if n not in other_width}, taken)
    model.load_state_dict(model.state_dict() | taken)


def _shared(weights: dict[str, Tensor], first: TreeRCNN, second: TreeRCNN) -> dict[str, Tensor]:
    """The weights without those of a mask or keypoint head that only one of two models has."""
    one_sided = {
        name
        for name in _BRANCHES
        if (getattr(first, name) is None) != (getattr(second, name) is None)
    }
    return {name: t for name, t in weights.items() if name.split(".")[0] not in one_sided}
