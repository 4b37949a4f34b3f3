"""Recognise the architecture of a Detectron2 checkpoint by names and shapes of its tensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from torch import Tensor

from perceptree.errors import CheckpointError
from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.models.presets import make_spec
from perceptree.models.spec import CLASS_NAMES, Modality, ModelSpec, SpecError
from perceptree.models.weights.anchors import Sizes, anchor_layout
from perceptree.models.weights.normalisation import PixelStd, StrideIn, normalisation
from perceptree.models.weights.reading import Tensors

# Blocks per stage, groups, and channels per group -> preset.
_ARCHITECTURES: dict[tuple[tuple[int, ...], int, int], str] = {
    ((3, 4, 6, 3), 1, 64): "r50",
    ((3, 4, 23, 3), 1, 64): "r101",
    ((3, 4, 23, 3), 32, 8): "x101-32x8d",
    ((3, 4, 23, 3), 32, 4): "x101-32x4d",
}
_EXPECTED = "Detectron2's Mask R-CNN with FPN (backbone.bottom_up, proposal_generator, roi_heads)"
_NEEDED = ("backbone.bottom_up.", "backbone.fpn_", "proposal_generator.", "roi_heads.box_head.")
# First part of a tensor name -> the unsupported network it belongs to, the most specific first.
_OTHERS = {
    "roi_heads.box_predictor.0.": "a Cascade R-CNN",
    "backbone.body.": "a torchvision detector",
    "neck.": "an mmdetection network",
    "head.cls_subnet": "a RetinaNet",
    "roi_heads.res5.": "a C4 network, without FPN,",
    "backbone.res5.": "a DC5 network, without FPN,",
    "conv1_w": "a Caffe2 network",
    "res2.0.": "a bare backbone",
    "layer1.0.": "a bare backbone",
}
# Layers after a head's convolutions.
_LAST_LAYERS = {"mask": ("deconv", "predictor"), "keypoint": ("score_lowres",)}


@dataclasses.dataclass(frozen=True)
class RecognisedNetwork:
    """The architecture and the input of a checkpoint."""

    preset: str
    """Preset of the architecture."""
    spec: ModelSpec
    """The spec; its mean and std are in BGR order."""
    assumed: tuple[str, ...]
    """Properties that the file does not state, assumed from the published configurations."""
    red_first: bool
    """Whether the network was trained on RGB, not on BGR."""


@dataclasses.dataclass(frozen=True)
class ImportOptions:
    """Options of the user, as for `importing.import_checkpoint`."""

    modality: Modality = "rgb"
    height: int | None = None
    width: int | None = None
    stride_in: StrideIn = "auto"
    pixel_std: PixelStd = "auto"
    as_init: bool = False
    anchor_sizes_px: Sizes | None = None
    anchor_ratios: tuple[float, ...] | None = None
    mask_convolutions: int = 4
    keypoint_convolutions: int = 8


def recognise(path: Path, tensors: Tensors, options: ImportOptions) -> RecognisedNetwork:
    """Recognise a network.

    Args:
        path: File that an error names.
        tensors: The file's tensors by Detectron2 name.
        options: Options of the user.

    Raises:
        CheckpointError: If the network is not supported, or its classes or keypoints are not this
            project's.
    """
    _check_kind(path, tensors)
    preset = _preset(path, tensors)
    base = make_spec(preset, options.modality, options.height, options.width)
    if not options.as_init:
        _check_counts(path, tensors)
    pixels = normalisation(path, tensors, options.stride_in, options.pixel_std, base.stride_in_1x1)
    anchors = anchor_layout(path, tensors, options.anchor_sizes_px, options.anchor_ratios)
    assumed = pixels.assumed + anchors.assumed
    changes: dict[str, Any] = {
        "mean": pixels.mean,
        "std": pixels.std,
        "stride_in_1x1": pixels.stride_in_1x1,
        "anchor_sizes_px": anchors.sizes_px,
        "anchor_ratios": anchors.ratios,
    }
    changes |= _widths(path, tensors, options)
    if options.modality == "depth":
        assumed += ("depth from 0 to 20 m as 0 to 255",)
    try:
        spec = dataclasses.replace(base, **changes)
    except SpecError as error:
        raise CheckpointError(f"{path}: {error}") from error
    return RecognisedNetwork(preset, spec, assumed, pixels.red_first)


def _check_kind(path: Path, tensors: Tensors) -> None:
    other = next((what for begin, what in _OTHERS.items() if _has(tensors, begin)), None)
    if other is None and all(_has(tensors, begin) for begin in _NEEDED):
        return
    first = ", ".join(list(tensors)[:3])
    raise CheckpointError(f"{path}: {other or 'a network'} with {first}; expected {_EXPECTED}")


def _preset(path: Path, tensors: Tensors) -> str:
    blocks = tuple(
        sum(1 for _ in _numbered(tensors, f"backbone.bottom_up.res{stage}.", ".conv1.weight", 0))
        for stage in range(2, 6)
    )
    out, per_group = _shape(path, tensors, "backbone.bottom_up.res2.0.conv2.weight", 4)[:2]
    groups = out // max(per_group, 1)
    preset = _ARCHITECTURES.get((blocks, groups, per_group))
    if preset is None:
        raise CheckpointError(
            f"{path}: the backbone has {blocks} blocks with {groups} groups of {per_group} "
            "channels, expected ResNet-50 or -101, or ResNeXt-101 32x8d or 32x4d"
        )
    return preset


def _check_counts(path: Path, tensors: Tensors) -> None:
    found, expected = [], []
    score = _shape(path, tensors, "roi_heads.box_predictor.cls_score.weight", 2)
    if score[0] != len(CLASS_NAMES) + 1:
        found.append(f"{score[0] - 1} classes")
        expected.append(f"{len(CLASS_NAMES)}")
    if _has(tensors, "roi_heads.keypoint_head."):
        maps = _shape(path, tensors, "roi_heads.keypoint_head.score_lowres.weight", 4)
        if maps[1] != len(KEYPOINT_NAMES):
            found.append(f"{maps[1]} keypoints")
            expected.append(f"{len(KEYPOINT_NAMES)}")
    if found:
        raise CheckpointError(
            f"{path}: {' and '.join(found)}, expected {' and '.join(expected)}; "
            "it can be imported as starting weights with --as-init"
        )


def _widths(path: Path, tensors: Tensors, options: ImportOptions) -> dict[str, Any]:
    """Which heads the network has, and the widths of its layers, as fields of ModelSpec."""
    widths: dict[str, Any] = {
        "fpn_width": _shape(path, tensors, "backbone.fpn_output2.weight", 4)[0],
        "box_head_width": _shape(path, tensors, "roi_heads.box_head.fc1.weight", 2)[0],
    }
    branches = {
        "mask": ("mask_fcn", options.mask_convolutions),
        "keypoint": ("conv_fcn", options.keypoint_convolutions),
    }
    for branch, (convolution, expected) in branches.items():
        head = f"roi_heads.{branch}_head."
        found = _has(tensors, head)
        widths[f"{branch}s"] = found or options.as_init
        if not found:
            continue
        begin = f"{head}{convolution}"
        count = sum(1 for _ in _numbered(tensors, begin, ".weight", 1))
        if count != expected:
            which = "missing" if count < expected else "unexpected"
            number = min(count, expected) + 1
            raise CheckpointError(
                f"{path}: {begin}{number}.weight is {which}, expected {expected} convolutions;"
                f" if the head has {count}, --{branch}-convolutions {count}"
            )
        for layer in _LAST_LAYERS[branch]:
            _shape(path, tensors, f"{head}{layer}.weight", 4)
        names = (f"{begin}{number}.weight" for number in range(1, count + 1))
        widths[f"{branch}_head_widths"] = tuple(_shape(path, tensors, n, 4)[0] for n in names)
    return widths


def _has(tensors: Tensors, begin: str) -> bool:
    return any(name.startswith(begin) for name in tensors)


def _numbered(tensors: Tensors, begin: str, end: str, first: int) -> Iterator[Tensor]:
    """The tensors named `begin`, number and `end`, for consecutive numbers from `first`."""
    while f"{begin}{first}{end}" in tensors:
        yield tensors[f"{begin}{first}{end}"]
        first += 1


def _shape(path: Path, tensors: Tensors, name: str, axes: int) -> tuple[int, ...]:
    value = tensors.get(name)
    if value is None:
        raise CheckpointError(f"{path}: {name} is missing")
    if value.dim() != axes:
        raise CheckpointError(
            f"{path}: {name} has shape {tuple(value.shape)}, expected {axes} axes"
        )
    return tuple(value.shape)
