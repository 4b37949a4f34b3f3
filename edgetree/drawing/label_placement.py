"""Where the labels of a picture stand: inside it, clear of each other and of the stems."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Rect", "place_plate"]

Rect: TypeAlias = tuple[int, int, int, int]
_Floats: TypeAlias = NDArray[np.floating[Any]]

_STEP_PX: Final = 8
# What one px² of something hidden costs, in px of distance from the tree.
_LABEL_COST: Final = 50.0
_STEM_COST: Final = 0.1


def place_plate(
    size_px: tuple[int, int],
    at_px: tuple[float, float, float],
    labels: list[Rect],
    stems: _Floats,
    picture_px: tuple[int, int],
) -> Rect:
    """The best place for a plate: near its tree, hiding no label and as little of stems as can be.

    Args:
        size_px: width and height of the plate.
        at_px: left and right edge of the tree's box and the height to stand at.
        labels: the plates that stand already.
        stems: (N, 4) x0, y0, x1, y1 of all stems.
        picture_px: width and height.
    """
    width, height = size_px
    left, right, level = at_px
    xs = _places(picture_px[0] - width, left - width, right)
    ys = _places(picture_px[1] - height, level - height / 2)
    aside = np.maximum(np.maximum(xs - right, left - (xs + width)), 0)
    cost = np.hypot(aside[None], (ys + height / 2 - level)[:, None])
    taken = np.array(labels, np.float64).reshape(-1, 4)
    for price, others in ((_LABEL_COST, taken), (_STEM_COST, stems)):
        across = _shared(xs, width, others[:, 0], others[:, 2])
        along = _shared(ys, height, others[:, 1], others[:, 3])
        cost += price * (along @ across.T)
    row, column = np.unravel_index(np.argmin(cost), cost.shape)
    x, y = round(float(xs[column])), round(float(ys[row]))
    return x, y, x + width, y + height


def _places(room_px: int, *wanted_px: float) -> _Floats:
    """Positions from 0 on that leave a plate within the picture, the wanted ones among them."""
    last = max(room_px, 0)
    grid = np.arange(0, last + 1, _STEP_PX)
    return np.unique(np.clip(np.append(grid, np.round(wanted_px)), 0, last))


def _shared(starts: _Floats, length: int, first: _Floats, last: _Floats) -> _Floats:
    """(P, N) px that P stretches of one length share with N others."""
    low = np.maximum(starts[:, None], first)
    return np.asarray(np.clip(np.minimum(starts[:, None] + length, last) - low, 0, None))
