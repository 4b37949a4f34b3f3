"""Find the anchors that a Detectron2 network was trained with."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import torch
from torch import Tensor

from perceptree.errors import CheckpointError
from perceptree.models.presets import NINE_ANCHORS_PX, ONE_SIZE_ANCHORS_PX
from perceptree.models.weights.reading import Tensors

RATIOS = (0.5, 1.0, 2.0)

_CELL = "proposal_generator.anchor_generator.cell_anchors."
_OBJECTNESS = "proposal_generator.rpn_head.objectness_logits.weight"
_LEVELS = 5
_TOLERANCE = 1e-4
_STATED_TOLERANCE = 1e-2  # a user may round
_SIZES_OPTION, _RATIOS_OPTION = "--anchor-sizes", "--anchor-ratios"

Sizes = tuple[tuple[float, ...], ...]


@dataclasses.dataclass(frozen=True)
class AnchorLayout:
    """Anchors of the levels 2 to 6."""

    sizes_px: Sizes
    """Square roots of the anchor areas, px, by level."""
    ratios: tuple[float, ...]
    """Height over width."""
    assumed: tuple[str, ...] = ()
    """What the file does not state, and why it was assumed."""


def anchor_layout(
    path: Path,
    tensors: Tensors,
    sizes_px: Sizes | None = None,
    ratios: tuple[float, ...] | None = None,
) -> AnchorLayout:
    """Determine anchor sizes and ratios.

    Files of older Detectron2 versions contain the anchor boxes. Otherwise they are the user's, or
    the number of anchors per cell decides: 3 is Detectron2's layout, 9 the layout that the paper
    describes.

    Args:
        path: File that an error names.
        tensors: The file's tensors by Detectron2 name.
        sizes_px: The user's sizes by level; None if not stated.
        ratios: The user's ratios; None if not stated.

    Raises:
        CheckpointError: If the layout is another one, or the file contradicts the user.
    """
    objectness = tensors.get(_OBJECTNESS)
    count = objectness.shape[0] if objectness is not None and objectness.dim() else 0
    if f"{_CELL}0" not in tensors:
        return _stated_layout(path, count, sizes_px, ratios)
    found = _file_layout(path, tensors, count)
    for option, stated, own in (
        (_SIZES_OPTION, sizes_px, found.sizes_px),
        (_RATIOS_OPTION, (ratios,) if ratios else None, (found.ratios,)),
    ):
        if stated is not None and not _close(stated, own):
            raise CheckpointError(
                f"{path}: {_CELL}* has {_listed(own)}, but {option} is {_listed(stated)}, expected"
                " the same"
            )
    return found


def _stated_layout(
    path: Path, count: int, sizes_px: Sizes | None, ratios: tuple[float, ...] | None
) -> AnchorLayout:
    """The user's layout; what the user does not state is assumed."""
    assumed: tuple[str, ...] = ()
    per_size = len(ratios or RATIOS)
    usual = {per_size: ONE_SIZE_ANCHORS_PX, 3 * per_size: NINE_ANCHORS_PX}
    if sizes_px is None and count in usual:
        sizes_px = usual[count]
        source = "Detectron2's" if sizes_px == ONE_SIZE_ANCHORS_PX else "of the paper"
        assumed += (f"anchor sizes {_listed(sizes_px)} px ({source} for {count} per cell)",)
    if ratios is None:
        assumed += (f"anchor ratios {_listed((RATIOS,))} (Detectron2's)",)
    if sizes_px is None:
        raise CheckpointError(
            f"{path}: {_OBJECTNESS} has {count} anchors per cell, expected"
            f" {' or '.join(map(str, usual))}, or {_SIZES_OPTION} and {_RATIOS_OPTION}"
        )
    per_level = {len(level) for level in sizes_px}
    if len(sizes_px) != _LEVELS or {size * per_size for size in per_level} != {count}:
        raise CheckpointError(
            f"{path}: {_OBJECTNESS} has {count} anchors per cell, but sizes {_listed(sizes_px)}"
            f" and ratios {_listed((ratios or RATIOS,))} were stated, expected {_LEVELS} levels of"
            f" {count} anchors, sizes times ratios"
        )
    return AnchorLayout(sizes_px, ratios or RATIOS, assumed)


def _file_layout(path: Path, tensors: Tensors, count: int) -> AnchorLayout:
    """The layout of the file's anchor boxes."""
    cells = [tensors.get(f"{_CELL}{level}") for level in range(_LEVELS)]
    boxes = [cell for cell in cells if cell is not None and _are_boxes(cell)]
    sizes = [_sizes(cell) for cell in boxes]
    ratios = _ratios(boxes[0], len(sizes[0])) if boxes else ()
    fit = [
        _matches(cell, level, ratios) and len(cell) == count
        for cell, level in zip(boxes, sizes, strict=True)
    ]
    if fit != [True] * _LEVELS:
        raise CheckpointError(
            f"{path}: unsupported anchors {_CELL}*, expected {count} boxes centred at 0 on each "
            f"of {_LEVELS} levels, with the same ratios"
        )
    return AnchorLayout(tuple(sizes), ratios)


def _close(first: Sizes, second: Sizes) -> bool:
    return [len(group) for group in first] == [len(group) for group in second] and all(
        math.isclose(a, b, rel_tol=_STATED_TOLERANCE)
        for group, other in zip(first, second, strict=True)
        for a, b in zip(group, other, strict=True)
    )


def _listed(groups: Sizes) -> str:
    """Sizes or ratios as the options take them: levels after commas, sizes of a level after /."""
    if len(groups) == 1:
        return ",".join(f"{value:g}" for value in groups[0])
    return ",".join("/".join(f"{value:g}" for value in group) for group in groups)


def _are_boxes(value: Tensor) -> bool:
    """Whether a tensor is (A, 4) xyxy with positive width and height."""
    if value.dim() != 2 or value.shape[1] != 4 or not len(value):
        return False
    return bool((value[:, 2:] > value[:, :2]).all())


def _sides(boxes: Tensor) -> list[list[float]]:
    sides: list[list[float]] = (boxes[:, 2:].double() - boxes[:, :2].double()).tolist()
    return sides


def _sizes(boxes: Tensor) -> tuple[float, ...]:
    """The distinct square roots of the boxes' areas, px, in the order of the boxes."""
    sizes: list[float] = []
    for w, h in _sides(boxes):
        size = _round_float32(math.sqrt(w * h))
        if not sizes or not math.isclose(size, sizes[-1], rel_tol=_TOLERANCE):
            sizes.append(size)
    return tuple(sizes)


def _ratios(boxes: Tensor, sizes: int) -> tuple[float, ...]:
    return tuple(_round_float32(h / w) for w, h in _sides(boxes)[: len(boxes) // sizes])


def _matches(boxes: Tensor, sizes: tuple[float, ...], ratios: tuple[float, ...]) -> bool:
    """Whether the boxes have these sizes and ratios, ratios varying fastest, and centre 0."""
    half = torch.tensor(
        [[s / math.sqrt(r) / 2, s * math.sqrt(r) / 2] for s in sizes for r in ratios]
    )
    made = torch.cat((-half, half), dim=1)
    if made.shape != boxes.shape:
        return False
    off = (made - boxes).abs().amax(dim=1)
    return bool((off <= _TOLERANCE * half.amax(dim=1)).all())


def _round_float32(value: float) -> float:
    """Round to 6 significant digits, which removes float32 rounding errors."""
    return float(f"{value:.6g}")
