"""A depth camera's scale and offset, from a flat target seen at known distances."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.camera import PinholeCamera
from calib.errors import CameraError, DepthError, InputFileError
from calib.files.text import parse, read_text
from calib.points import pixels_to_rays
from calib.writing import write_whole

Float = NDArray[np.floating[Any]]

SCHEMA: Final = "calib.depth_scale/1"
_EXPECTED: Final = "a depth scale as JSON"
_LEAST_READINGS, _LEAST_TARGETS, _LEAST_DISTANCES = 50, 4, 3
_SAME_DISTANCE, _LEAST_RANGE, _LEAST_FOLLOWING = 1.1, 1.5, 1.2
_MEDIAN_TO_STD, _FAR_OFF, _NEVER_BELOW = 1.4826, 4.0, 0.002


@dataclass(frozen=True, eq=False)
class TargetReadings:
    """A flat target as one depth map shows it: (N,) ``true_m`` and ``measured_m`` along z of the
    same pixels. What was measured as 0 or is not finite is no reading. ``focal_std_share`` is the
    standard deviation of the camera's focal length as a share of it: ``true_m`` is off by as much.
    """

    name: str
    true_m: Float
    measured_m: Float
    focal_std_share: float = 0.0


@dataclass(frozen=True)
class TargetResidual:
    """What the fit leaves of one target.

    ``residual_m`` is the corrected mean reading less the true distance; ``noise_std_m`` how far
    the readings of its ``pixels`` scatter about their plane.
    """

    name: str
    distance_m: float
    residual_m: float
    noise_std_m: float
    pixels: int


@dataclass(frozen=True)
class DepthScale:
    """True depth = ``scale`` x reading + ``offset_m``, fitted to targets between ``nearest_m`` and
    ``farthest_m``. ``correlation`` is that of the errors of the two; ``dropped`` names the targets
    that did not agree with the others. Raises DepthError for values that no fit gives.
    """

    scale: float
    offset_m: float
    scale_std: float
    offset_std_m: float
    correlation: float
    nearest_m: float
    farthest_m: float
    targets: tuple[TargetResidual, ...] = ()
    dropped: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("scale", "scale_std", "offset_std_m", "nearest_m", "farthest_m"):
            value = getattr(self, name)
            least = 0 if name.endswith(("std", "std_m")) else math.ulp(0.0)
            if not (math.isfinite(value) and value >= least):
                raise DepthError(f"{name} is {value}: expected a positive number")
        if not math.isfinite(self.offset_m):
            raise DepthError(f"offset_m is {self.offset_m}: expected a finite number")
        if not -1 <= self.correlation <= 1:
            raise DepthError(f"correlation is {self.correlation}: expected -1 to 1")

    def apply(self, depth_m: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
        """(...) readings in metres, 0 = none, to true metres; what would come to lie behind the
        camera becomes no reading.
        """
        depths = np.asarray(depth_m, np.float32)
        true_m = depths * np.float32(self.scale) + np.float32(self.offset_m)
        return np.where((depths > 0) & np.isfinite(depths) & (true_m > 0), true_m, 0)

    def std_m(self, depth_m: ArrayLike) -> Float:
        """(...) standard deviation that the fit adds to corrected readings of (...) metres."""
        depths = np.asarray(depth_m, np.float64)
        mixed = 2 * self.correlation * self.scale_std * self.offset_std_m
        variance = (depths * self.scale_std) ** 2 + mixed * depths + self.offset_std_m**2
        return np.asarray(np.sqrt(np.maximum(variance, 0)))

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        values = asdict(self)
        return {**values, "targets": list(values["targets"]), "dropped": list(self.dropped)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> DepthScale:
        """From ``to_dict``'s values; raises DepthError for what is missing or of another kind."""
        targets, dropped = values.get("targets", []), values.get("dropped", [])
        if not isinstance(targets, list) or not all(isinstance(t, Mapping) for t in targets):
            raise DepthError(f"targets is {targets!r}: expected a list of objects")
        if not isinstance(dropped, list) or not all(isinstance(name, str) for name in dropped):
            raise DepthError(f"dropped is {dropped!r}: expected a list of names")
        names = [field.name for field in fields(cls) if field.type == "float"]
        return cls(
            **{name: _number(values, name) for name in names},
            targets=tuple(_target(target) for target in targets),
            dropped=tuple(dropped),
        )


@dataclass(frozen=True)
class DepthScaleFailure:
    """No depth scale, and why. Falsy."""

    reason: str

    def __bool__(self) -> Literal[False]:
        return False


def read_target(
    name: str,
    camera: PinholeCamera,
    pose: Sequence[float],
    points_px: ArrayLike,
    depth_m: NDArray[np.floating[Any]],
) -> TargetReadings:
    """The readings of a board whose ``pose`` (rotation vector and metres, board to camera) is
    known, inside the hull of its (N, 2) corner-based points.

    ``depth_m`` (H, W) lies in the camera's pixels. Raises CameraError where it has another size.
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


def fit_depth_scale(targets: Sequence[TargetReadings]) -> DepthScale | DepthScaleFailure:
    """Scale and offset from flat targets, each of which counts once, whatever its pixels.

    The readings of one target share the errors of its place and of the sensor's pattern, so the
    targets' scatter about the line, and not that of the pixels, gives the standard deviations.
    The error of the focal length stretches the distances of all targets alike, and so the line.
    Errors are taken to grow with the distance. Targets that do not agree are left out. A failure
    where there are fewer than 4 targets with readings, at fewer than 3 distances, or where the
    farthest is not 1.5 times as far as the nearest: offset and scale cannot be told apart.
    """
    means = [mean for mean in map(_mean_of, targets) if mean is not None]
    dropped = {target.name for target in targets} - {mean.name for mean in means}
    while (reason := _too_little(means)) is None:
        wrong = _disagreeing(means)
        if wrong is None:
            break
        dropped.add(wrong.name)
        means.remove(wrong)
    if reason is not None:
        return DepthScaleFailure(reason)
    line, covariance, _ = _fit_line(means)
    if line[0] <= 0:
        return DepthScaleFailure(f"readings change by {line[0]:.2g} m for each metre of distance")
    stretch = max(target.focal_std_share for target in targets) * line
    covariance = covariance + np.outer(stretch, stretch)
    return _result(means, line, covariance, [t.name for t in targets if t.name in dropped])


@dataclass(frozen=True)
class _Mean:
    """One target's mean true and measured depth, without stray pixels."""

    name: str
    true_m: float
    measured_m: float
    noise_std_m: float
    pixels: int

    def relative(self) -> Float:
        """(2,) that scale and offset make 1 of, if they are right."""
        return np.array([self.measured_m, 1.0]) / self.true_m


def _mean_of(target: TargetReadings) -> _Mean | None:
    """None where there are too few readings. Stray ones are those of another ratio."""
    valid = np.isfinite(target.measured_m) & (target.measured_m > 0) & (target.true_m > 0)
    true_m, measured_m = target.true_m[valid], target.measured_m[valid]
    if len(true_m) < _LEAST_READINGS:
        return None
    ratio = measured_m / true_m
    middle = float(np.median(ratio))
    spread = _MEDIAN_TO_STD * float(np.median(np.abs(ratio - middle)))
    near = np.abs(ratio - middle) <= max(_FAR_OFF * spread, _NEVER_BELOW)
    true_m, measured_m = true_m[near], measured_m[near]
    along_m, off_m = true_m - true_m.mean(), measured_m - measured_m.mean()
    slope = float(along_m @ off_m) / max(float(along_m @ along_m), 1e-12)
    noise_std_m = float(np.std(off_m - slope * along_m))
    return _Mean(
        target.name, float(true_m.mean()), float(measured_m.mean()), noise_std_m, len(true_m)
    )


def _too_little(means: Sequence[_Mean]) -> str | None:
    """Why these targets give no line, if they give none."""
    if len(means) < _LEAST_TARGETS:
        return (
            f"{len(means)} targets with depth that agree with each other,"
            f" expected at least {_LEAST_TARGETS}"
        )
    distances_m = sorted(mean.true_m for mean in means)
    apart = [distances_m[0]]
    for distance_m in distances_m:
        if distance_m > _SAME_DISTANCE * apart[-1]:
            apart.append(distance_m)
    if len(apart) < _LEAST_DISTANCES or distances_m[-1] < _LEAST_RANGE * distances_m[0]:
        return (
            f"the target was {distances_m[0]:.2f} to {distances_m[-1]:.2f} m away: expected at"
            f" least {_LEAST_DISTANCES} distances, the farthest {_LEAST_RANGE} times the nearest,"
            " to tell offset from scale"
        )
    readings_m = [mean.measured_m for mean in means]
    if max(readings_m) < _LEAST_FOLLOWING * min(readings_m):
        return (
            f"the readings went from {min(readings_m):.2f} to {max(readings_m):.2f} m as the target"
            f" went from {distances_m[0]:.2f} to {distances_m[-1]:.2f} m"
        )
    return None


def _fit_line(means: Sequence[_Mean]) -> tuple[Float, Float, float]:
    """(2,) scale and offset of least squared relative errors, their (2, 2) covariance, and the
    variance of those errors.
    """
    rows = np.array([mean.relative() for mean in means])
    line = np.linalg.lstsq(rows, np.ones(len(means)))[0]
    variance = float(np.sum((rows @ line - 1) ** 2)) / (len(means) - 2)
    return line, variance * np.linalg.pinv(rows.T @ rows), variance


def _disagreeing(means: Sequence[_Mean]) -> _Mean | None:
    """The target farthest from what the others say, by its standard deviations there, if that is
    far; the fewer the others are, the less they know of how targets scatter.
    """
    freedom = len(means) - 3
    far_off = []
    for i, mean in enumerate(means):
        line, covariance, variance = _fit_line([*means[:i], *means[i + 1 :]])
        row = mean.relative()
        std = max(math.sqrt(variance + row @ covariance @ row), _NEVER_BELOW)
        far_off.append(abs(float(row @ line) - 1) / std)
    worst = int(np.argmax(far_off))
    return means[worst] if far_off[worst] > _FAR_OFF * (1 + _FAR_OFF / freedom) else None


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


def _number(values: Mapping[str, Any], name: str) -> float:
    value = values.get(name)
    if not isinstance(value, bool) and isinstance(value, int | float):
        with suppress(OverflowError):
            if math.isfinite(float(value)):
                return float(value)
    raise DepthError(f"{name} is {value!r}: expected a finite number")


def _target(values: Mapping[str, Any]) -> TargetResidual:
    numbers = {name: _number(values, name) for name in ("distance_m", "residual_m", "noise_std_m")}
    return TargetResidual(str(values.get("name")), **numbers, pixels=int(_number(values, "pixels")))


def load_depth_scale(path: Path | str) -> DepthScale:
    """Read a depth scale; raises InputFileError or DepthError with the file's name."""
    path = Path(path)
    values = parse(path, read_text(path, _EXPECTED), _EXPECTED)
    found = values.get("schema") if isinstance(values, Mapping) else type(values).__name__
    if not isinstance(values, Mapping) or found != SCHEMA:
        raise InputFileError(f"{path}: schema is {found!r}, expected {SCHEMA!r}")
    try:
        return DepthScale.from_dict(values)
    except DepthError as error:
        raise DepthError(f"{path}: {error}") from error


def save_depth_scale(path: Path | str, depth_scale: DepthScale) -> None:
    """Write a depth scale; raises InputFileError where the file cannot be written."""
    text = json.dumps({"schema": SCHEMA, **depth_scale.to_dict()}, indent=1)
    write_whole(Path(path), f"{text}\n".encode())
