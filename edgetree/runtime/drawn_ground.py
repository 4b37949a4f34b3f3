"""Ground for depth pictures that show stems and no ground, as a network needs it to find them.

Scans come with their ground removed, and some sensors get no readings from it. Networks learned
that stems stand on ground, and miss most of them without it. The ground is drawn into what the
network sees alone: it is never measured.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np

from basetree.arrays import Bool, Float, Float32
from edgetree.runtime.pairs import ColourAndDepth, FrameImage

# The picture is looked at in columns and rows of this number across it.
_COLUMNS: Final = 100
# A picture with readings in this share of its lowest third is not looked at further.
_LOWEST_THIRD_SHARE: Final = 0.6
# Trial planes: their horizon above the picture's middle and the slope of that, as shares of height
# and width, with the spread of how cameras are held; their inverse depth a height below it, per m.
_HORIZONS, _HORIZON_STD = np.linspace(-0.6, 0.6, 25), 0.2
_ROLLS, _ROLL_STD = np.linspace(-0.1, 0.1, 5), 0.05
_STEEPNESSES: Final = np.geomspace(0.05, 4.0, 56)
# Feet leave the plane by this share of their distance; costs of what is above it and below it.
_UNEVEN: Final = 0.08
_COST_ABOVE, _COST_BELOW = 3.0, 6.0
# Columns of one stem have one foot: so many columns count as one reading.
_COLUMNS_PER_FOOT: Final = 5.0
_LEAST_FEET: Final = 4  # columns
# Ground is looked for up to the first distance and drawn up to the second.
_LOOKED_M, _DRAWN_M = 12.0, 20.0
# The picture shows no ground if of that area this share at least has no reading, and of the
# readings there less than this share lies on the plane, within so much of its distance.
_LEAST_EMPTY, _MOST_ON_PLANE, _ON_PLANE = 0.4, 0.5, 0.15
_LEAST_AREA: Final = 0.02
# Holes of a surface up to this share of the picture's width are not filled with ground.
_HOLE_SHARE: Final = 0.015


class _Lowest(NamedTuple):
    """The lowest readings of columns (N,): the feet of stems, and what hangs above the ground.

    Attributes:
        x, y: Places from the middle, as shares of the picture's width and height.
        inverse_m: Their inverse depth.
        is_cut: Whether the picture ends there, so that their foot is lower.
    """

    x: Float
    y: Float
    inverse_m: Float
    is_cut: Bool


def frame_with_ground(image: FrameImage) -> Float32 | None:
    """`with_ground` of an image that is depth alone, in metres; None for all others."""
    if isinstance(image, ColourAndDepth) or image.dtype.kind != "f":
        return None
    return with_ground(image)


def with_ground(depth_m: Float32) -> Float32 | None:
    """Draw a plane through the feet of the stems of a depth picture that shows no ground.

    The inverse depth of a plane is linear in the places of a pinhole camera's picture, so that no
    camera need be known.

    Args:
        depth_m: (H, W) depth; 0, NaN and infinity are no readings.

    Returns:
        (H, W) depth with a plane where there are no readings below its horizon; None if the
        picture shows ground, or no feet.
    """
    step = max(1, round(depth_m.shape[1] / _COLUMNS))
    few_m = _readings(depth_m[::step, ::step])
    if (few_m[len(few_m) * 2 // 3 :] > 0).mean() > _LOWEST_THIRD_SHARE:
        return None
    plane = _lower_plane(_lowest(few_m))
    if plane is None or _shows_ground(few_m, _inverse_depth(plane, few_m.shape)):
        return None
    inverse = _inverse_depth(plane, depth_m.shape)
    known_m = _readings(depth_m)
    is_drawn = (known_m == 0) & ~_closed(known_m > 0) & (inverse > 1 / _DRAWN_M)
    return np.where(is_drawn, 1 / np.maximum(inverse, 1 / _DRAWN_M), known_m).astype(np.float32)


def _closed(is_read: Bool) -> Bool:
    """Readings and the holes between them: no ground is seen through a stem."""
    side = 2 * round(_HOLE_SHARE / 2 * is_read.shape[1]) + 1
    square = np.ones((side, side), np.uint8)
    closed = cv2.morphologyEx(is_read.astype(np.uint8), cv2.MORPH_CLOSE, square)
    return np.asarray(closed > 0)


def _readings(depth_m: Float32) -> Float32:
    with np.errstate(over="ignore"):  # float64 values beyond float32 become inf, no reading
        depth_m = depth_m.astype(np.float32, copy=False)
    return np.where(np.isfinite(depth_m), depth_m, np.float32(0))


def _lowest(depth_m: Float32) -> _Lowest:
    rows, columns = depth_m.shape
    is_read = depth_m > 0
    column = np.flatnonzero(is_read.any(0))
    row = rows - 1 - np.argmax(is_read[::-1, column], axis=0)
    x, y = (column + 0.5) / columns - 0.5, (row + 1) / rows - 0.5
    return _Lowest(x, y, 1 / depth_m[row, column].astype(np.float64), row == rows - 1)


def _lower_plane(lowest: _Lowest) -> tuple[float, float, float] | None:
    """The most likely plane with many feet on it and little below: (x, y, 1) to inverse depth."""
    if np.count_nonzero(~lowest.is_cut) < _LEAST_FEET:
        return None
    below = lowest.y - _HORIZONS[:, None, None] - _ROLLS[:, None] * lowest.x
    is_below = below > 0
    # How steep a plane through each reading is, (horizon, roll, reading), and its trial planes.
    steepness = np.log(lowest.inverse_m / np.where(is_below, below, 1.0))
    trials = np.log(_STEEPNESSES)[:, None]
    above = np.where(is_below[..., None, :], steepness[..., None, :] - trials, np.inf) / _UNEVEN
    # What the picture cuts off has its foot lower, so that all above the plane is alike.
    most = np.where(above > 0, np.where(lowest.is_cut, 0.0, _COST_ABOVE), _COST_BELOW)
    cost = np.minimum(above**2 / 2, most).sum(-1) / _COLUMNS_PER_FOOT
    cost += ((_HORIZONS / _HORIZON_STD) ** 2 / 2)[:, None, None]
    cost += ((_ROLLS / _ROLL_STD) ** 2 / 2)[:, None]
    horizon, roll, steep = np.unravel_index(cost.argmin(), cost.shape)
    slope = float(_STEEPNESSES[steep])
    return -slope * float(_ROLLS[roll]), slope, -slope * float(_HORIZONS[horizon])


def _inverse_depth(plane: tuple[float, float, float], shape: tuple[int, ...]) -> Float:
    """(H, W) inverse depth of a plane in 1/m, negative above its horizon."""
    rows, columns = shape
    x = (np.arange(columns) + 0.5) / columns - 0.5
    y = (np.arange(rows) + 0.5) / rows - 0.5
    return plane[0] * x + (plane[1] * y + plane[2])[:, None]


def _shows_ground(depth_m: Float32, inverse: Float) -> bool:
    """Whether readings lie where the plane is, or the plane is not in the picture."""
    near = inverse > 1 / _LOOKED_M
    is_read = depth_m > 0
    if near.mean() < _LEAST_AREA or np.mean(is_read[near]) > 1 - _LEAST_EMPTY:
        return True
    read = near & is_read
    is_on_plane = np.abs(inverse[read] * depth_m[read] - 1) < _ON_PLANE
    return bool(np.count_nonzero(is_on_plane) > _MOST_ON_PLANE * np.count_nonzero(read))
