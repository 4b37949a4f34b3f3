"""Find the anchors that a Detectron2 network was trained with."""

from __future__ import annotations

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

Sizes = tuple[tuple[float, ...], ...]


def anchor_layout(path: Path, tensors: Tensors) -> tuple[Sizes, tuple[float, ...]]:
    """Determine anchor sizes and ratios.

    Files of older Detectron2 versions contain the anchor boxes. Otherwise the number of anchors
    per cell decides: 3 is Detectron2's layout, 9 the layout that the paper describes.

    Args:
        path: File that an error names.
        tensors: The file's tensors by Detectron2 name.

    Returns:
        Sizes (square roots of areas, px) of the levels 2 to 6, and ratios of height over width.

    Raises:
        CheckpointError: If the layout is another one.
    """
    objectness = tensors.get(_OBJECTNESS)
    count = objectness.shape[0] if objectness is not None and objectness.dim() else 0
    cells = [tensors.get(f"{_CELL}{level}") for level in range(_LEVELS)]
    if cells[0] is None:
        layouts = {3: ONE_SIZE_ANCHORS_PX, 9: NINE_ANCHORS_PX}
        if count not in layouts:
            raise CheckpointError(f"{path}: {count} anchors per cell, expected 3 or 9")
        return layouts[count], RATIOS
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
    return tuple(sizes), ratios


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
