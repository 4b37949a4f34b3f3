"""Import of published Detectron2 checkpoints."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import torch
from torch import Tensor

from basetree.errors import SettingsError
from basetree.files.reading import file_sha256
from perceptree.errors import CheckpointError
from perceptree.models.checkpoint import check_tensors, check_values, tensors_of
from perceptree.models.detector import TreeRCNN
from perceptree.models.spec import Modality, ModelSpec
from perceptree.models.weights.detectron2 import our_name, their_name
from perceptree.models.weights.normalisation import PixelStd, StrideIn
from perceptree.models.weights.reading import Tensors, read_weights
from perceptree.models.weights.recognition import ImportOptions, RecognisedNetwork, recognise

_STEM = "backbone.bottom_up.stem.conv1.weight"
# Tensors that are no weights: constants of the configuration, and counters of the training.
_CONSTANTS = ("pixel_mean", "pixel_std", "proposal_generator.anchor_generator.")
_COUNTER = "num_batches_tracked"
# Layers that depend on the classes and keypoints of the original task. Starting weights for
# another task do not use them.
_TASK_LAYERS = ("box_head.score.", "box_head.shift.", "keypoint_head.tower.up.")
_MASK_SCORE = "mask_head.score."  # depends on the classes too; kept if it fits
_SEED = 0


@dataclasses.dataclass(frozen=True)
class Imported:
    """A network with imported weights."""

    model: TreeRCNN
    """The network, in eval mode."""
    preset: str
    """Preset of the architecture."""
    assumed: tuple[str, ...]
    """Properties that the file does not state, assumed from the published configurations."""
    training: dict[str, Any]
    """The training record for `save_checkpoint`: source of the weights, and the tensors that
    keep their random initial values (`fresh`)."""


def import_checkpoint(
    path: str | Path,
    *,
    modality: Modality = "rgb",
    height: int | None = None,
    width: int | None = None,
    stride_in: StrideIn = "auto",
    pixel_std: PixelStd = "auto",
    as_init: bool = False,
    anchor_sizes_px: Sequence[Sequence[float]] | None = None,
    anchor_ratios: Sequence[float] | None = None,
    mask_convolutions: int = 4,
    keypoint_convolutions: int = 8,
) -> Imported:
    """Import a Detectron2 Mask R-CNN with FPN and a ResNet-50, -101 or ResNeXt-101 backbone.

    Args:
        path: A `.pth` or `.pkl` file.
        modality: Input of the network, `rgb` or `depth`.
        height: Height of the frames, px; 720 by default.
        width: Width of the frames, px; 1280 by default.
        stride_in: Convolution of the bottlenecks that has the stride; `auto` uses the published
            configuration of the backbone.
        pixel_std: Standard deviation of the input, 1 or ImageNet's; `auto` uses the file's
            value or the published configuration.
        as_init: Import starting weights from a network for another task, such as COCO's persons.
            The layers that depend on the task get reproducible random weights.
        anchor_sizes_px: Sizes (square roots of areas, px) of each of the levels 2 to 6; by default
            the file's, or the usual ones for its number of anchors.
        anchor_ratios: Height over width of the anchors; by default the file's, or 0.5, 1 and 2.
        mask_convolutions: Convolutions of the mask head before its deconvolution.
        keypoint_convolutions: Convolutions of the keypoint head before its deconvolution.

    Raises:
        CheckpointError: If the file cannot be read or is damaged, is another kind of network, or
            contradicts an option.
        SettingsError: If an option is none of its choices.
    """
    path = Path(path)
    _check_choice("stride_in", stride_in, get_args(StrideIn))
    _check_choice("pixel_std", pixel_std, get_args(PixelStd))
    _check_choice("modality", modality, ("rgb", "depth"))
    tensors = read_weights(path)
    _check_floats(path, tensors)
    check_values(path, tensors)
    options = ImportOptions(
        modality,
        height,
        width,
        stride_in,
        pixel_std,
        as_init,
        None if anchor_sizes_px is None else tuple(tuple(level) for level in anchor_sizes_px),
        None if anchor_ratios is None else tuple(anchor_ratios),
        mask_convolutions,
        keypoint_convolutions,
    )
    found = recognise(path, tensors, options)
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


def _check_floats(path: Path, tensors: Tensors) -> None:
    """Check that all tensors but counters are floats; 8-bit weights lack their scales."""
    for name, value in tensors.items():
        if not value.is_floating_point() and not name.endswith(_COUNTER):
            kind = str(value.dtype).removeprefix("torch.")
            raise CheckpointError(f"{path}: {name} is {kind}, expected floating-point numbers")


def _weights(tensors: Tensors, found: RecognisedNetwork) -> Tensors:
    """The tensors that are weights, with the first convolution converted to BGR input."""
    kept = {
        name: value
        for name, value in tensors.items()
        if not name.startswith(_CONSTANTS) and not name.endswith(_COUNTER)
    }
    if found.red_first and _STEM in kept:
        kept[_STEM] = kept[_STEM].flip(1)
    return kept


def _shapes(spec: ModelSpec) -> dict[str, Tensor]:
    """The model's weights on the meta device, to check shapes before memory is allocated."""
    return {name: value for name, value in tensors_of(spec).items() if not name.endswith(_COUNTER)}


def _fresh(shapes: dict[str, Tensor], weights: Tensors) -> list[str]:
    """Names of the model's tensors that keep their random initial values."""
    present = {our_name(name).partition(".")[0] for name in weights}
    fresh = []
    for name, value in shapes.items():
        theirs = weights.get(their_name(name))
        fits = theirs is not None and theirs.shape == value.shape
        other_classes = name.startswith(_MASK_SCORE) and not fits
        if name.startswith(_TASK_LAYERS) or other_classes or name.partition(".")[0] not in present:
            fresh.append(name)
    return fresh


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        option = "--" + name.replace("_", "-")
        raise SettingsError(f"{option} is {value!r}, expected one of: {', '.join(choices)}")
