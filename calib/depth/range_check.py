"""Tell by the ground whether a map holds depth along the optical axis, or range along the rays.

Let s be the length of a pixel's ray with z = 1, and r = (x, y, 1) that ray. On a plane, the inverse
depth is linear, n . r. Of a reading v that is depth, 1 / v = n . r; of one that is range,
1 / v = n . r / s. So readings of a plane follow 1 / v = n . r s^-p with the exponent p = 0 for
depth and 1 for range, and p = -1 for depth that was converted as if it were range. The exponent is
estimated together with n by Gauss-Newton steps with Cauchy's weights.

Ground is no plane, and its hills and hollows are of the same kind as the curvature. What they
change is in proportion to the ground's scatter about the plane.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Float
from basetree.normal import MEDIAN_ABS_NORMAL
from calib.camera import PinholeCamera
from calib.depth.convention import DepthKind
from calib.errors import Failure
from calib.ground import GroundPlaneFailure, fit_ground_plane
from calib.points import check_size, pixels_to_rays

_SAMPLES: Final = 60  # along the shorter side of the map
_NEAREST_M, _FARTHEST_M = 0.3, 15.0
_LEAST_READINGS: Final = 200
_TOLERANCE_M: Final = 0.2  # of the first plane
_NEAR_M, _NEAR_SHARE = 0.15, 0.06  # readings this near to it, or this share of their distance
_LEAST_HEIGHT_M = _LEAST_EXTENT_M = 0.4  # smaller surfaces are stems and stones
_STEPS: Final = 10
_CAUCHY: Final = 2.0
# On 60 simulated frames whose ground scatters by 4.6 % of the distance in the median, hills changed
# the readings across the picture by 1.7 % (root mean square).
_HILLS_PER_SCATTER: Final = 0.4
_LEAST_SCATTER: Final = 0.02
_MOST_STD: Final = 0.35
_ALARM_STDS, _FITS_STDS = 3.0, 2.5
_INDEPENDENT_FRAMES: Final = 4  # a drive sees the same ground again and again


class RangeExponent(NamedTuple):
    """The power of the rays' length in the readings of the ground.

    Attributes:
        value: 0 for depth, 1 for range.
        std: Its standard deviation.
    """

    value: float
    std: float


def range_exponent(
    depth_m: Float,
    camera: PinholeCamera,
    up: ArrayLike | None = None,
    kind: DepthKind = "depth",
) -> RangeExponent | Failure:
    """Estimate from the ground whether a depth map holds depth, or range along the rays.

    Args:
        depth_m: (H, W) metres, 0 for no reading.
        camera: Camera of the map.
        up: (3,) direction away from gravity in camera coordinates; the camera's own up if None.
        kind: How the map was taken: of "range", it holds what `range_to_depth` gave.

    Returns:
        The exponent, or a falsy Failure if too little ground is seen, or too little towards the
        borders of the picture.

    Raises:
        CameraError: If the map does not have the camera's size.
    """
    check_size(camera, depth_m)
    rays, readings_m = _sampled(depth_m, camera)
    lengths = np.linalg.norm(rays, axis=1)
    # Between both meanings, so that neither finds more of the plane.
    half = 0.5 if kind == "depth" else -0.5
    points_m = rays * (readings_m / lengths**half)[:, None]
    plane = fit_ground_plane(points_m, up, tolerance_m=_TOLERANCE_M)
    if isinstance(plane, GroundPlaneFailure):
        return Failure(f"no ground: {plane.reason}")
    apart_m = np.abs(plane.height_m(points_m))
    near = apart_m < np.maximum(_NEAR_M, _NEAR_SHARE * readings_m)
    is_small = plane.offset_m < _LEAST_HEIGHT_M or plane.extents_m.min() < _LEAST_EXTENT_M
    if is_small or np.count_nonzero(near) < _LEAST_READINGS:
        return Failure("no ground: too little of a plane is seen")
    found = _fit_exponent(rays[near], 1 / readings_m[near], np.log(lengths[near]))
    if not found.std <= _MOST_STD:
        return Failure("the ground seen is too uneven, or too near the middle of the picture")
    return found


def _sampled(depth_m: Float, camera: PinholeCamera) -> tuple[Float, Float]:
    """Rays (N, 3) with z = 1 and readings (N,) on a grid."""
    step = max(1, min(depth_m.shape) // _SAMPLES)
    rows, columns = (np.arange(step // 2, size, step) for size in depth_m.shape)
    readings_m = np.asarray(depth_m[np.ix_(rows, columns)], np.float64)
    usable = (readings_m > _NEAREST_M) & (readings_m < _FARTHEST_M)
    centres_px = np.stack(np.meshgrid(columns + 0.5, rows + 0.5), -1)[usable]
    return pixels_to_rays(camera, centres_px), readings_m[usable]


def _fit_exponent(rays: Float, inverse: Float, log_length: Float) -> RangeExponent:
    """Fit 1 / v = n . r s^-p to N readings of one plane.

    Args:
        rays: (N, 3) rays r with z = 1.
        inverse: (N,) inverse readings 1 / v.
        log_length: (N,) logarithms of the rays' lengths s.
    """
    exponent, weight = 0.5, 1 / inverse  # relative errors of depth are alike
    residual = scatter = weight
    by_exponent = -log_length * inverse
    for _ in range(_STEPS):
        by_plane = rays * np.exp(-exponent * log_length)[:, None]
        columns = np.column_stack([by_plane, by_exponent]) * weight[:, None]
        wanted = (inverse + by_exponent * exponent) * weight
        solution = np.linalg.lstsq(columns, wanted, rcond=None)[0]
        exponent = float(np.clip(solution[3], -10, 10))
        fitted = rays @ solution[:3] * np.exp(-exponent * log_length)
        residual = inverse / np.where(fitted == 0, np.inf, fitted) - 1
        scatter = np.median(np.abs(residual)) / MEDIAN_ABS_NORMAL
        scale = _CAUCHY * max(float(scatter), 1e-6)
        weight = 1 / inverse / np.sqrt(1 + (residual / scale) ** 2)
    # What of the exponent's effect no plane explains, as a share of the readings.
    effect, plane = columns[:, 3], columns[:, :3]
    left = effect - plane @ np.linalg.lstsq(plane, effect, rcond=None)[0]
    told = math.sqrt(float(left @ left) / float((weight * inverse) @ (weight * inverse)))
    hills = _HILLS_PER_SCATTER * max(float(scatter), _LEAST_SCATTER)
    return RangeExponent(exponent, hills / max(told, 1e-9))


def kind_words(exponents: Sequence[RangeExponent], kind: DepthKind) -> str | None:
    """Say that the depth of some frames looks like the other kind; None if it does not.

    Args:
        exponents: Those of the frames, after they were taken for `kind`.
        kind: How the depth was taken.
    """
    if not exponents:
        return None
    value = float(np.median([each.value for each in exponents]))
    std = float(np.median([each.std for each in exponents]))
    std /= math.sqrt(min(len(exponents), _INDEPENDENT_FRAMES))
    expected = 1.0 if kind == "depth" else -1.0
    is_other = value * expected > _ALARM_STDS * std and abs(value - expected) < _FITS_STDS * std
    if not is_other:
        return None
    other = "range" if kind == "depth" else "depth"
    taken = "depth along the optical axis" if kind == "depth" else "range along the rays"
    return (
        f"the depth is taken for {taken}, but the ground is curved as in {other} (exponent"
        f" {abs(value):.2f} ± {std:.2f} of the rays' length, expected 0): metres towards the"
        f" borders of the picture are wrong if so; give --depth-kind {other}"
    )
