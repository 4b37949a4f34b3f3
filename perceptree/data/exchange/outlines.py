"""Outlines of labelled trees as polygons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from basetree.arrays import Float64
from calib import mask_polygons
from perceptree.data.coco import FrameRecord, TreeRecord

_TOLERANCE_PX: Final = 0.5
"""Masks are traced so exactly: at 1 px, narrow ones lose a tenth of their cells."""


def outlines(frame: FrameRecord, tree: TreeRecord) -> list[Float64]:
    """Return the polygons (N, 2) of a tree in continuous px: those of its label, or of its mask."""
    if tree.segmentation is None:
        return []
    parts = tree.segmentation
    if not isinstance(parts, list):
        parts = mask_polygons(frame.mask(tree), _TOLERANCE_PX)
    return [np.array(part, np.float64).reshape(-1, 2) for part in parts]


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
