"""Place labels inside a picture so that they hide neither each other nor stems."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

Rect: TypeAlias = tuple[int, int, int, int]
"""x0, y0, x1, y1 in pixels."""
_Floats: TypeAlias = NDArray[np.floating[Any]]

_STEP_PX: Final = 8
# Cost of hiding one px², in px of distance from the tree.
_LABEL_COST: Final = 50.0
_STEM_COST: Final = 0.1


def place_label(
    size_px: tuple[int, int],
    at_px: tuple[float, float, float],
    labels: list[Rect],
    stems: _Floats,
    picture_px: tuple[int, int],
) -> Rect:
    """Find the best position of a label.

    All positions on a grid are compared. The cost of a position is its distance from the tree plus
    the weighted areas of other labels and of stems that the label would hide.

    Args:
        size_px: Width and height of the label.
        at_px: Left and right edge of the tree's box, and the preferred y of the label's centre.
        labels: Areas that are already taken.
        stems: (N, 4) boxes of all stems, x0, y0, x1, y1.
        picture_px: Width and height of the picture.

    Returns:
        The rectangle of the label.
    """
    width, height = size_px
    left, right, level = at_px
    xs = _places(picture_px[0] - width, left - width, right)
    ys = _places(picture_px[1] - height, level - height / 2)
    gap = np.maximum(np.maximum(xs - right, left - (xs + width)), 0)
    cost = np.hypot(gap[None], (ys + height / 2 - level)[:, None])
    taken = np.array(labels, np.float64).reshape(-1, 4)
    for price, others in ((_LABEL_COST, taken), (_STEM_COST, stems)):
        across = _shared(xs, width, others[:, 0], others[:, 2])
        along = _shared(ys, height, others[:, 1], others[:, 3])
        cost += price * (along @ across.T)
    row, column = np.unravel_index(np.argmin(cost), cost.shape)
    x, y = round(float(xs[column])), round(float(ys[row]))
    return x, y, x + width, y + height


def _places(room_px: int, *wanted_px: float) -> _Floats:
    """Candidate positions between 0 and `room_px`: a grid, and the wanted ones."""
    last = max(room_px, 0)
    grid = np.arange(0, last + 1, _STEP_PX)
    return np.unique(np.clip(np.append(grid, np.round(wanted_px)), 0, last))


def _shared(starts: _Floats, length: int, first: _Floats, last: _Floats) -> _Floats:
    """(P, N) overlap in px of P intervals of one length with N other intervals."""
    low = np.maximum(starts[:, None], first)
    return np.asarray(np.clip(np.minimum(starts[:, None] + length, last) - low, 0, None))
