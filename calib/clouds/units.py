"""Tell from the heights in a cloud whether its coordinates can be metres."""

from __future__ import annotations

from typing import Final

import numpy as np

from basetree.arrays import Float

# Heights are compared within cells of this width, or of this share of the cloud, so that slopes do
# not count. What stands in them is the height that this share of the cells does not exceed.
_CELL, _CELL_SHARE = 5.0, 0.02
_QUANTILE: Final = 0.9
# Trees of forests are lower than the first height in metres, and than the second one in feet.
_TALLEST_M, _TALLEST_FEET = 65.0, 300.0
_SAMPLED_POINTS: Final = 200_000


def doubted_unit(points: Float) -> str | None:
    """What makes it unlikely that coordinates are metres, and what to do; None if nothing does.

    Args:
        points: (N, 3) coordinates, the third one up.
    """
    points = points[:: len(points) // _SAMPLED_POINTS + 1]
    low, high = points.min(0), points.max(0)
    width = max(_CELL, _CELL_SHARE * float((high - low)[:2].max()))
    column, row = ((points[:, :2] - low[:2]) / width).astype(np.intp).T
    cell = np.unique(row * (column.max() + 1) + column, return_inverse=True)[1]
    lowest, highest = np.full(cell.max() + 1, np.inf), np.full(cell.max() + 1, -np.inf)
    np.minimum.at(lowest, cell, points[:, 2])
    np.maximum.at(highest, cell, points[:, 2])
    tall = float(np.quantile(highest - lowest, _QUANTILE))
    if tall <= _TALLEST_M:
        return None
    unit, factor = ("feet", "0.3048") if tall < _TALLEST_FEET else ("millimetres", "0.001")
    return (
        f"trees of it would be {tall:.0f} m tall, so that its coordinates are likely {unit}:"
        f" expected metres; multiply them by {factor}, as with PDAL or CloudCompare"
    )
