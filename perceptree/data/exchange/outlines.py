"""Outlines of labelled trees as polygons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import cv2
import numpy as np

from basetree.arrays import Bool, Float64
from calib import mask_polygons
from perceptree.data.coco import FrameRecord, TreeRecord

_TOLERANCE_PX: Final = 0.5
"""Masks are traced so exactly: at 1 px, narrow ones lose a tenth of their cells."""

HOLES: Final = "masks whose holes are filled, as outlines hold none: {}"
SMALL_PARTS: Final = "masks that lose parts smaller than 1 % of their largest part: {}"


class Outlines(NamedTuple):
    """The outlines of a tree, and what they lack of its mask.

    Attributes:
        parts: Polygons (N, 2) in continuous px.
        fills_holes: Whether the mask has holes, which are filled.
        drops_parts: Whether the mask has small parts, which are left out.
    """

    parts: list[Float64]
    fills_holes: bool = False
    drops_parts: bool = False


def outlines(frame: FrameRecord, tree: TreeRecord) -> Outlines:
    """Return the outlines of a tree: the polygons of its label, or those traced from its mask."""
    if tree.segmentation is None:
        return Outlines([])
    if isinstance(tree.segmentation, list):
        return Outlines(_arrays(tree.segmentation))
    mask = frame.mask(tree)
    parts = _arrays(mask_polygons(mask, _TOLERANCE_PX))
    has_holes, count = _holes_and_parts(mask)
    return Outlines(parts, has_holes, count > len(parts))


def _arrays(polygons: Sequence[Sequence[float]]) -> list[Float64]:
    return [np.array(polygon, np.float64).reshape(-1, 2) for polygon in polygons]


def _holes_and_parts(mask: Bool) -> tuple[bool, int]:
    """Whether a mask (H, W) has holes, and how many parts it has when they are filled.

    Cells that touch at a corner are of one part, as for `mask_polygons`.
    """
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not rows.size:
        return False, 0
    inner = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    padded = np.pad(inner, 1)
    _, empty = cv2.connectedComponents((~padded).astype(np.uint8), connectivity=4)
    filled = np.asarray(empty != empty[0, 0])
    count = cv2.connectedComponents(filled.astype(np.uint8), connectivity=8)[0] - 1
    return bool((filled & ~padded).any()), int(count)


def joined(parts: Sequence[Float64]) -> Float64:
    """Join polygons to one, by lines to and fro between their nearest corners.

    Args:
        parts: Polygons (N, 2), at least one.

    Returns:
        (M, 2), the corners of all of them; each further part begins and ends at the same corner.
    """
    whole, *rest = parts
    for part in rest:
        gaps = np.hypot(*(whole[:, None] - part).transpose(2, 0, 1))
        here, there = np.unravel_index(int(gaps.argmin()), gaps.shape)
        around = np.concatenate([part[there:], part[: there + 1]])
        whole = np.concatenate([whole[: here + 1], around, whole[here:]])
    return whole
