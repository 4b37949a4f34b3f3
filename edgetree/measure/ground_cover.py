"""Tell plants that hide the ground by their surface: its depth is unsteady.

Where grass hides the ground, the lowest plane of the depth lies within the grass, and all heights
above it are too low. Nothing below it is seen, but two things tell grass from ground. Its depth
changes from one place to the next a few centimetres beside it, where that of the ground is smooth;
and the readings spread more about the plane than the noise of the depth explains, because no
surface holds them. Both are compared with the noise of the depth, which the bark of the stems
shows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from basetree.arrays import Bool, Float
from basetree.normal import MEDIAN_ABS_NORMAL
from calib import GroundPlane, GroundPlaneFailure, project_points
from edgetree.measure.constants.ground import (
    BESIDE_M,
    CLOSED_COVER_FACTOR,
    CLOSED_COVER_SHARE,
    CLOSED_COVER_STD_M,
    GAP_STDS,
    MIN_BESIDE_PX,
    MIN_GAP_READINGS,
    MIN_UNSTEADINESS,
    STD_PER_UNSTEADINESS_M,
    UNEVEN_STD_M,
)
from edgetree.measure.edge_lines import masked_medians, median
from edgetree.measure.frame import DepthFrame
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.stem_fit import Readings

# Of sparse depth so few places can be compared that those beside the stem count too much.
_MIN_COMPARED = 12
# Of the readings across a stem these are looked at: few to save time, and none near its edges.
_ACROSS = slice(2, -2, 2)
# The standard deviation of 2 b - a - c for independent errors of standard deviation 1.
_BEND_STD = 6**0.5


def noise_factor(readings: Readings, stations: int, settings: MeasureSettings) -> float:
    """How much larger the noise of the depth is on the bark of a frame's stems than assumed.

    The inverse depth of a straight stem changes linearly along it. So its second differences along
    the stem are noise.

    Args:
        readings: T stems' readings, the same number across the stem at each station.
        stations: Number of stations along each stem.
        settings: The assumed noise.

    Returns:
        The ratio of the standard deviations, at least 1.
    """
    depth_m = readings.depth_m.reshape(len(readings.depth_m), stations, -1)[..., _ACROSS]
    before, middle, after = depth_m[:, :-2], depth_m[:, 1:-1], depth_m[:, 2:]
    used = (before > 0) & (middle > 0) & (after > 0)
    if not used.any():
        return 1.0
    before, middle, after = before[used], middle[used], after[used]
    ratio = _bend_m(before, middle, after) / settings.depth_stds_m(middle)
    return max(median(ratio) / MEDIAN_ABS_NORMAL, 1.0)


def cover_stds_m(
    frame: DepthFrame,
    points: Float,
    usable: Bool,
    depth_std_m: Float,
    planes: Sequence[GroundPlane | GroundPlaneFailure],
) -> Float:
    """Standard deviations of the ground's height because plants may hide it.

    Args:
        frame: Depth, camera and masks.
        points: (T, N, 3) camera points to which the planes were fitted.
        usable: (T, N) which of them were used.
        depth_std_m: (T, N) standard deviations of their depths.
        planes: T planes.

    Returns:
        (T,) metres, 0 where the surface is as steady as ground.
    """
    normals = np.zeros((len(planes), 3, 1))
    residuals_m, above = np.zeros(len(planes)), np.ones(len(planes))
    for index, plane in enumerate(planes):
        if isinstance(plane, GroundPlane):
            normals[index, :, 0], residuals_m[index] = plane.normal, plane.residual_std_m
            above[index] = plane.above_fraction
    depth_m = np.where(usable, points[..., 2], 1.0)
    # An error of the depth changes a height by this factor times as much.
    slopes = np.abs(np.matmul(points, normals)[..., 0]) / depth_m
    noise_m = np.sqrt(UNEVEN_STD_M**2 + (slopes * depth_std_m) ** 2)
    left_m, right_m = _beside(frame, points, usable)
    known = usable & (left_m > 0) & (right_m > 0)
    known &= known.sum(1, keepdims=True) >= _MIN_COMPARED
    left_m, right_m = (np.where(known, side_m, 1.0) for side_m in (left_m, right_m))
    roughness = masked_medians(slopes * _bend_m(left_m, depth_m, right_m) / noise_m, known)
    spread = residuals_m / np.maximum(masked_medians(noise_m, usable), UNEVEN_STD_M)
    std_m = STD_PER_UNSTEADINESS_M * np.maximum(spread + roughness - MIN_UNSTEADINESS, 0.0)
    closed = np.maximum(1 - above / CLOSED_COVER_SHARE, 0.0)
    return std_m + CLOSED_COVER_FACTOR * closed * np.maximum(std_m - CLOSED_COVER_STD_M, 0.0)


def gap_depth_m(points: Float, std_m: Float, plane: GroundPlane) -> float:
    """How far below a plane the gaps between plants show deeper ground, in metres; 0 if none do.

    Args:
        points: (N, 3) camera points beside the stem that may be ground.
        std_m: (N,) standard deviations of their heights above the plane.
        plane: The plane.
    """
    below_m = -plane.height_m(points)
    deep_m = below_m[below_m > GAP_STDS * std_m]
    return median(deep_m) if len(deep_m) >= MIN_GAP_READINGS else 0.0


def _bend_m(before_m: Float, middle_m: Float, after_m: Float) -> Float:
    """Depth errors that three depths on a line in the image show, as for one of them.

    On planes and straight stems the inverse depth is linear along such a line.
    """
    bend = 2 / middle_m - 1 / before_m - 1 / after_m
    return np.asarray(np.abs(bend) * middle_m**2 / _BEND_STD)


def _beside(frame: DepthFrame, points: Float, usable: Bool) -> tuple[Float, Float]:
    """(T, N) depths in metres at the left and at the right of points, 0 where there is none.

    A few are on a stem, too few for the median to notice.
    """
    xyz = np.where(usable[..., None], points, (0.0, 0.0, 1.0))
    middle_px = project_points(frame.camera, xyz)
    step_px = np.maximum(BESIDE_M * frame.camera.fx / xyz[..., 2], MIN_BESIDE_PX)
    step_px = np.rint(step_px)[..., None] * (1.0, 0.0)
    return frame.depth_at(middle_px - step_px), frame.depth_at(middle_px + step_px)
