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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import GroundPlane, GroundPlaneFailure, project_points
from edgetree.measure.edge_lines import masked_medians
from edgetree.measure.frame import DepthFrame
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.stem_fit import Readings

__all__ = ["cover_stds_m", "depth_stds_m", "noise_factor"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

# The places that are compared lie this far to the left and right of a reading, but at least so many
# pixels: neighbouring pixels share the noise of stereo cameras.
_BESIDE_M, _MIN_BESIDE_PX = 0.025, 2.0
# The unevenness of ground, as a standard deviation.
_UNEVEN_STD_M = 0.05 / 3
# Unsteadiness is the spread about the plane plus this factor times the roughness, both in standard
# deviations of a ground reading. From the second value on, plants may hide the ground. The standard
# deviation of its height grows with the rest by the third value in metres.
# Fitted on 468 ray-traced scenes (grass of 0.1 to 0.5 m on none to 90 % of the ground) and 100
# frames each of the simulator's presets `field` and `vegetation`.
_ROUGHNESS_FACTOR, _STEADY, _STD_PER_UNSTEADINESS_M = 1.2, 1.68, 0.34
# The median of the size of a normally distributed error, in standard deviations.
_MEDIAN_ERROR = 0.6745
# The standard deviation of 2 b - a - c for independent errors of standard deviation 1.
_BEND_STD = 6**0.5


def depth_stds_m(settings: MeasureSettings, depth_m: Float) -> Float:
    """Assumed standard deviations of depth readings, of the same shape as they."""
    return np.hypot(settings.depth_noise_m, settings.depth_noise_per_m * depth_m**2)


def noise_factor(readings: Readings, stations: int, settings: MeasureSettings) -> float:
    """How much larger the noise of the depth is on the bark of a frame's stems than assumed.

    The inverse depth of a straight stem changes linearly along it. So its second differences along
    the stem are noise.

    Args:
        readings: T stems' readings, the same number across the stem at each station.
        stations: number of stations along each stem.
        settings: the assumed noise.

    Returns:
        The ratio of the standard deviations, at least 1.
    """
    depth_m = readings.depth_m.reshape(len(readings.depth_m), stations, -1)
    known = depth_m > 0
    depth_m = np.where(known, depth_m, 1.0)
    inverse = 1 / depth_m
    bend = np.abs(2 * inverse[:, 1:-1] - inverse[:, :-2] - inverse[:, 2:])
    middle_m = depth_m[:, 1:-1]
    ratio = bend * middle_m**2 / (_BEND_STD * depth_stds_m(settings, middle_m))
    used = known[:, 1:-1] & known[:, :-2] & known[:, 2:]
    return max(float(np.median(ratio[used])) / _MEDIAN_ERROR, 1.0) if used.any() else 1.0


def cover_stds_m(
    frame: DepthFrame,
    points: Float,
    usable: Flags,
    planes: Sequence[GroundPlane | GroundPlaneFailure],
    noise: float,
) -> Float:
    """Standard deviations of the ground's height because plants may hide it.

    Args:
        frame: depth, camera and masks.
        points: (T, N, 3) camera points to which the planes were fitted.
        usable: (T, N) which of them were used.
        planes: T planes.
        noise: ratio of the noise of the depth to the assumed one.

    Returns:
        (T,) metres, 0 where the surface is as steady as ground.
    """
    normals = np.array([plane.normal if plane else (0.0, 0.0, 0.0) for plane in planes])[..., None]
    residuals_m = np.array([plane.residual_std_m if plane else 0.0 for plane in planes])
    depth_m = np.where(usable, points[..., 2], 1.0)
    slopes = np.abs(np.matmul(points, normals)[..., 0]) / depth_m
    std_m = np.hypot(_UNEVEN_STD_M, noise * slopes * depth_stds_m(frame.settings, depth_m))
    bends, known = _bends(frame, points, usable)
    bend_m = np.abs(np.matmul(bends, normals)[..., 0]) / _BEND_STD
    roughness = masked_medians(bend_m / std_m, known)
    spread = residuals_m / np.maximum(masked_medians(std_m, usable), _UNEVEN_STD_M)
    unsteadiness = spread + _ROUGHNESS_FACTOR * roughness
    return _STD_PER_UNSTEADINESS_M * np.maximum(unsteadiness - _STEADY, 0.0)


def _bends(frame: DepthFrame, points: Float, usable: Flags) -> tuple[Float, Flags]:
    """How far points lie from the middle between their neighbours to the left and right, twice.

    Returns:
        (T, N, 3) differences in metres, and (T, N) whether both neighbours are known.
    """
    xyz = np.where(usable[..., None], points, (0.0, 0.0, 1.0))
    middle_px = project_points(frame.camera, xyz)
    step_px = np.maximum(_BESIDE_M * frame.camera.fx / xyz[..., 2], _MIN_BESIDE_PX)
    step_px = step_px[..., None] * (1.0, 0.0)
    beside_px = np.concatenate([middle_px - step_px, middle_px + step_px], axis=1)
    rays, depth_m = frame.readings(beside_px)
    left, right = np.split(rays * depth_m[..., None], 2, axis=1)
    known = (depth_m > 0) & ~frame.on_any_stem(beside_px)
    return 2 * xyz - left - right, usable & np.logical_and(*np.split(known, 2, axis=1))
