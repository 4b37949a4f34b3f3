"""The anchors that a Detectron2 network was trained with."""

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
    """Sizes (px) of each level from 2 to 6, and ratios of height over width.

    From the file's own boxes, which older versions keep; else by the number of anchors of a
    cell. Raises CheckpointError for any other layout.
    """
    objectness = tensors.get(_OBJECTNESS)
    count = objectness.shape[0] if objectness is not None and objectness.dim() else 0
    cells = [tensors.get(f"{_CELL}{level}") for level in range(_LEVELS)]
    if cells[0] is None:
        layouts = {3: ONE_SIZE_ANCHORS_PX, 9: NINE_ANCHORS_PX}
        if count not in layouts:
            raise CheckpointError(f"{path}: {count} anchors a cell, expected 3 or 9")
        return layouts[count], RATIOS
    boxes = [cell for cell in cells if cell is not None and _are_boxes(cell)]
    sizes = [_sizes(cell) for cell in boxes]
    ratios = _ratios(boxes[0], len(sizes[0])) if boxes else ()
    fit = [
        _fit(cell, level, ratios) and len(cell) == count
        for cell, level in zip(boxes, sizes, strict=True)
    ]
    if fit != [True] * _LEVELS:
        raise CheckpointError(
            f"{path}: {_CELL}* are not {count} boxes of the same sizes and ratios about 0 "
            f"on each of {_LEVELS} levels"
        )
    return tuple(sizes), ratios


def _are_boxes(value: Tensor) -> bool:
    """Whether it is (A, 4) xyxy px with sides over 0."""
    if value.dim() != 2 or value.shape[1] != 4 or not len(value):
        return False
    return bool((value[:, 2:] > value[:, :2]).all())


def _sides(boxes: Tensor) -> list[list[float]]:
    sides: list[list[float]] = (boxes[:, 2:].double() - boxes[:, :2].double()).tolist()
    return sides


def _sizes(boxes: Tensor) -> tuple[float, ...]:
    """The square roots of the boxes' areas, px, each once, in the boxes' order."""
    sizes: list[float] = []
    for w, h in _sides(boxes):
        size = _tidy(math.sqrt(w * h))
        if not sizes or not math.isclose(size, sizes[-1], rel_tol=_TOLERANCE):
            sizes.append(size)
    return tuple(sizes)


def _ratios(boxes: Tensor, sizes: int) -> tuple[float, ...]:
    return tuple(_tidy(h / w) for w, h in _sides(boxes)[: len(boxes) // sizes])


def _fit(boxes: Tensor, sizes: tuple[float, ...], ratios: tuple[float, ...]) -> bool:
    """Whether the boxes are these sizes and ratios about 0, ratios fastest."""
    half = torch.tensor(
        [[s / math.sqrt(r) / 2, s * math.sqrt(r) / 2] for s in sizes for r in ratios]
    )
    made = torch.cat((-half, half), dim=1)
    if made.shape != boxes.shape:
        return False
    off = (made - boxes).abs().amax(dim=1)
    return bool((off <= _TOLERANCE * half.amax(dim=1)).all())


def _tidy(value: float) -> float:
    """Without what float32 added."""
    return float(f"{value:.6g}")
