"""Import of published checkpoints: a stranger's file becomes a network of ours, with a record."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, get_args

import torch
from torch import Tensor

from perceptree.errors import SettingsError
from perceptree.models.checkpoint import check_tensors
from perceptree.models.detector import TreeRCNN
from perceptree.models.spec import Modality, ModelSpec
from perceptree.models.weights.detectron2 import our_name, their_name
from perceptree.models.weights.reading import Tensors, file_sha256, read_weights
from perceptree.models.weights.recognition import (
    PixelStd,
    Recognised,
    StrideIn,
    Wanted,
    recognise,
)

_STEM = "backbone.bottom_up.stem.conv1.weight"
# Constants of the configuration, and what a training keeps beside the weights.
_CONSTANTS = ("pixel_mean", "pixel_std", "proposal_generator.anchor_generator.")
_COUNTER = "num_batches_tracked"
# Layers that say what was learnt to be found, which for starting weights is something else.
_LEARNT_ANEW = ("box_head.score.", "box_head.shift.", "keypoint_head.tower.up.")
_SEED = 0


@dataclasses.dataclass(frozen=True)
class Imported:
    """A network with the weights of another's checkpoint."""

    model: TreeRCNN
    """In eval mode."""
    preset: str
    assumed: tuple[str, ...]
    """What the file did not say and was taken from the published configurations."""
    training: dict[str, Any]
    """The record for ``save_checkpoint``: where the weights come from, and which are fresh."""


def import_checkpoint(
    path: str | Path,
    *,
    modality: Modality = "rgb",
    height: int | None = None,
    width: int | None = None,
    stride_in: StrideIn = "auto",
    pixel_std: PixelStd = "auto",
    as_init: bool = False,
) -> Imported:
    """Read a Detectron2 Mask R-CNN with FPN on ResNet-50, -101 or ResNeXt-101.

    ``height`` and ``width`` (px) are of the frames it is to see, 720 and 1280 if not given.
    ``stride_in`` and ``pixel_std`` override what the file, or its backbone, suggests.
    ``as_init`` takes a network that was trained on other things, such as COCO's persons, as
    starting weights: the layers that say what was found are fresh, always the same ones.
    Raises CheckpointError or SettingsError with one line.
    """
    path = Path(path)
    _check_choice("stride_in", stride_in, get_args(StrideIn))
    _check_choice("pixel_std", pixel_std, get_args(PixelStd))
    _check_choice("modality", modality, get_args(Modality))
    tensors = read_weights(path)
    wanted = Wanted(modality, height, width, stride_in, pixel_std, as_init)
    found = recognise(path, tensors, wanted)
    weights = _weights(tensors, found)
    shapes = _shapes(found.spec)
    fresh = _fresh(shapes, weights) if as_init else []
    used = {name: value for name, value in weights.items() if our_name(name) not in fresh}
    expected = {their_name(name): value for name, value in shapes.items() if name not in fresh}
    check_tensors(path, expected, used)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(_SEED)
        model = TreeRCNN(found.spec)
    state = {our_name(name): value for name, value in used.items()}
    model.load_state_dict(state, strict=False)
    training = {
        "data": f"imported from {path.name}",
        "source": path.name,
        "sha256": file_sha256(path),
        "init_only": as_init,
        "assumed": list(found.assumed),
        "fresh": fresh,
    }
    return Imported(model.eval(), found.preset, found.assumed, training)


def _weights(tensors: Tensors, found: Recognised) -> Tensors:
    """The tensors that are weights, for input in our order of colours."""
    kept = {
        name: value
        for name, value in tensors.items()
        if not name.startswith(_CONSTANTS) and not name.endswith(_COUNTER)
    }
    if found.red_first and _STEM in kept:
        kept[_STEM] = kept[_STEM].flip(1)
    return kept


def _shapes(spec: ModelSpec) -> dict[str, Tensor]:
    """Our weights without memory behind them, so that false shapes are found before it is used."""
    with torch.device("meta"):
        state = TreeRCNN(spec).state_dict()
    return {name: value for name, value in state.items() if not name.endswith(_COUNTER)}


def _fresh(shapes: dict[str, Tensor], weights: Tensors) -> list[str]:
    """Our tensors that starting weights leave as they are made."""
    fresh = []
    for name, value in shapes.items():
        theirs = weights.get(their_name(name))
        fits = theirs is not None and theirs.shape == value.shape
        optional = name.startswith("keypoint_head.") and theirs is None
        optional |= name.startswith("mask_head.") and not fits
        if name.startswith(_LEARNT_ANEW) or optional:
            fresh.append(name)
    return fresh


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        option = "--" + name.replace("_", "-")
        raise SettingsError(f"{option} is {value!r}, expected one of: {', '.join(choices)}")
