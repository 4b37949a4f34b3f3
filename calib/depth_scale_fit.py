"""Fit scale and offset of a depth camera to a flat target at known distances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Float
from basetree.normal import MAD_TO_STD
from calib.camera import PinholeCamera
from calib.depth_scale import DepthScale, TargetResidual
from calib.errors import CameraError, Failure
from calib.points import pixels_to_rays
from calib.scale_limits import tell_scale

_MIN_READINGS, _MIN_TARGETS, _MIN_DISTANCES = 50, 4, 3
# Ratios: of distances that count as one, of farthest to nearest target, of their readings.
_SAME_DISTANCE_RATIO, _MIN_DISTANCE_RATIO, _MIN_READING_RATIO = 1.1, 1.5, 1.2
# Outliers lie more than _OUTLIER_STDS away; a standard deviation is taken as at least _STD_FLOOR.
_OUTLIER_STDS, _STD_FLOOR = 4.0, 0.002


@dataclass(frozen=True, eq=False)
class TargetReadings:
    """Readings of one depth map on a flat target, with the true depths.

    Attributes:
        name: Name for messages, such as the file's.
        true_m: (N,) true metres along z of the pixels on the target.
        measured_m: (N,) readings of the same pixels in metres; 0 or not finite is no reading.
        focal_std_share: Relative standard deviation of the camera's focal length. It is also the
            relative error of `true_m`, which comes from the target's size in the image.
    """

    name: str
    true_m: Float
    measured_m: Float
    focal_std_share: float = 0.0


class DepthScaleFailure(Failure):
    """The reason why no depth scale could be fitted. Falsy."""


def read_target(
    name: str,
    camera: PinholeCamera,
    pose: Sequence[float],
    points_px: ArrayLike,
    depth_m: Float,
) -> TargetReadings:
    """Collect the readings on a calibration board with a known pose.

    Args:
        name: Name for messages.
        camera: Camera of the depth map.
        pose: Rotation vector and translation in metres (6 numbers), board to camera coordinates.
        points_px: (N, 2) continuous px of board points; pixels inside their convex hull are used.
        depth_m: (H, W) metres along z in the camera's pixels.

    Raises:
        CameraError: If the depth map does not have the camera's size.
    """
    height, width = depth_m.shape
    if (width, height) != (camera.width, camera.height):
        raise CameraError(
            f"depth of {name} is {width}x{height} px: expected the camera's"
            f" {camera.width}x{camera.height}"
        )
    inside = np.zeros((height, width), np.uint8)
    hull = cv2.convexHull(np.floor(np.asarray(points_px)).astype(np.int32))
    cv2.fillConvexPoly(inside, hull, 1)
    rows, columns = np.nonzero(inside)
    rays = pixels_to_rays(camera, np.stack([columns, rows], -1) + 0.5)
    normal = cv2.Rodrigues(np.array(pose[:3], np.float64))[0][:, 2]
    true_m = (normal @ np.array(pose[3:])) / (rays @ normal)
    measured_m = np.asarray(depth_m[rows, columns], np.float64)
    return TargetReadings(name, true_m, measured_m, camera.focal_std_px / camera.fx)


def fit_depth_scale(
    targets: Sequence[TargetReadings], side_m: float | None = None
) -> DepthScale | DepthScaleFailure:
    """Fit scale and offset to flat targets at different distances.

    The fit minimises the relative errors of the targets' mean depths. Each target has the same
    weight, whatever its number of pixels: readings of one target share its placement error and the
    sensor's pattern error. The standard deviations therefore come from the targets' scatter about
    the line. The focal length's uncertainty, which scales all true depths alike, is added. Outlying
    targets are left out and named.

    Args:
        targets: Readings of each target.
        side_m: Side of a square or tag of the board that was given, for messages.

    Returns:
        A DepthScale, or a falsy DepthScaleFailure if fewer than 4 targets agree, if they stood at
        fewer than 3 distances, if the farthest is less than 1.5 times as far as the nearest,
        because then offset and scale cannot be separated, or if the scale is beyond that of depth
        cameras, because then the board's size or the unit is wrong.
    """
    means = [mean for mean in map(_mean_of, targets) if mean is not None]
    dropped = {target.name for target in targets} - {mean.name for mean in means}
    while (reason := _insufficient(means)) is None:
        wrong = _find_outlier(means)
        if wrong is None:
            break
        dropped.add(wrong.name)
        means.remove(wrong)
    if reason is not None:
        return DepthScaleFailure(reason)
    line, covariance, _ = _fit_line(means)
    if line[0] <= 0:
        return DepthScaleFailure(f"the fitted scale is {line[0]:.2g}: expected more than 0")
    stretch = max(target.focal_std_share for target in targets) * line
    covariance = covariance + np.outer(stretch, stretch)
    refused, _ = tell_scale(float(line[0]), math.sqrt(covariance[0, 0]), side_m)
    if refused is not None:
        return DepthScaleFailure(refused)
    return _result(means, line, covariance, [t.name for t in targets if t.name in dropped])


@dataclass(frozen=True)
class _Mean:
    """Mean true and measured depth of one target, outlying pixels removed."""

    name: str
    true_m: float
    measured_m: float
    noise_std_m: float
    pixels: int

    def relative(self) -> Float:
        """Return the (2,) row of the least-squares system: row @ (scale, offset) should be 1."""
        return np.array([self.measured_m, 1.0]) / self.true_m


def _mean_of(target: TargetReadings) -> _Mean | None:
    """Average one target; None if it has too few readings.

    Pixels are outliers if their ratio of measured to true depth is far from the median ratio.
    """
    valid = np.isfinite(target.measured_m) & (target.measured_m > 0) & (target.true_m > 0)
    true_m, measured_m = target.true_m[valid], target.measured_m[valid]
    if len(true_m) < _MIN_READINGS:
        return None
    ratio = measured_m / true_m
    middle = float(np.median(ratio))
    spread = MAD_TO_STD * float(np.median(np.abs(ratio - middle)))
    near = np.abs(ratio - middle) <= max(_OUTLIER_STDS * spread, _STD_FLOOR)
    true_m, measured_m = true_m[near], measured_m[near]
    along_m, off_m = true_m - true_m.mean(), measured_m - measured_m.mean()
    slope = float(along_m @ off_m) / max(float(along_m @ along_m), 1e-12)
    noise_std_m = float(np.std(off_m - slope * along_m))
    return _Mean(
        target.name, float(true_m.mean()), float(measured_m.mean()), noise_std_m, len(true_m)
    )


def _insufficient(means: Sequence[_Mean]) -> str | None:
    """Return why a line cannot be fitted to these targets, or None if it can."""
    if len(means) < _MIN_TARGETS:
        return (
            f"{len(means)} targets with depth that agree with each other,"
            f" expected at least {_MIN_TARGETS}"
        )
    distances_m = sorted(mean.true_m for mean in means)
    distinct_m = [distances_m[0]]
    for distance_m in distances_m:
        if distance_m > _SAME_DISTANCE_RATIO * distinct_m[-1]:
            distinct_m.append(distance_m)
    if len(distinct_m) < _MIN_DISTANCES or distances_m[-1] < _MIN_DISTANCE_RATIO * distances_m[0]:
        return (
            f"the target was {distances_m[0]:.2f} to {distances_m[-1]:.2f} m away: expected at"
            f" least {_MIN_DISTANCES} distances, the farthest {_MIN_DISTANCE_RATIO} times the"
            " nearest, to separate offset and scale"
        )
    readings_m = [mean.measured_m for mean in means]
    if max(readings_m) < _MIN_READING_RATIO * min(readings_m):
        return (
            f"the readings went from {min(readings_m):.2f} to {max(readings_m):.2f} m as the target"
            f" went from {distances_m[0]:.2f} to {distances_m[-1]:.2f} m"
        )
    return None


def _fit_line(means: Sequence[_Mean]) -> tuple[Float, Float, float]:
    """Minimise the squared relative errors.

    Returns:
        (2,) scale and offset, their (2, 2) covariance, and the variance of the relative errors.
    """
    rows = np.array([mean.relative() for mean in means])
    line = np.linalg.lstsq(rows, np.ones(len(means)))[0]
    variance = float(np.sum((rows @ line - 1) ** 2)) / (len(means) - 2)
    return line, variance * np.linalg.pinv(rows.T @ rows), variance


def _find_outlier(means: Sequence[_Mean]) -> _Mean | None:
    """Return the target that deviates most from the fit to the others, if it is an outlier.

    The deviation is measured in standard deviations of the prediction. The threshold is higher when
    there are few other targets, because their scatter is then poorly known.
    """
    degrees_of_freedom = len(means) - 3
    deviations = []
    for i, mean in enumerate(means):
        line, covariance, variance = _fit_line([*means[:i], *means[i + 1 :]])
        row = mean.relative()
        std = max(math.sqrt(variance + row @ covariance @ row), _STD_FLOOR)
        deviations.append(abs(float(row @ line) - 1) / std)
    worst = int(np.argmax(deviations))
    return (
        means[worst]
        if deviations[worst] > _OUTLIER_STDS * (1 + _OUTLIER_STDS / degrees_of_freedom)
        else None
    )


def _result(
    means: Sequence[_Mean], line: Float, covariance: Float, dropped: Sequence[str]
) -> DepthScale:
    scale_std, offset_std_m = (float(value) for value in np.sqrt(np.diag(covariance)))
    both = scale_std * offset_std_m
    residuals = tuple(
        TargetResidual(
            m.name, m.true_m, (float(m.relative() @ line) - 1) * m.true_m, m.noise_std_m, m.pixels
        )
        for m in means
    )
    return DepthScale(
        float(line[0]),
        float(line[1]),
        scale_std,
        offset_std_m,
        float(np.clip(covariance[0, 1] / both, -1, 1)) if both > 0 else 0.0,
        min(mean.true_m for mean in means),
        max(mean.true_m for mean in means),
        residuals,
        tuple(dropped),
    )
