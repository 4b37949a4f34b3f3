"""The errors of a rig, which all stems and all frames share."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from basetree.arrays import Float
from basetree.errors import InputError
from calib import PinholeCamera
from edgetree.measure.constants.rig import (
    DEPTH_SCALE_STD,
    PRINCIPAL_STD_SHARE,
    ROTATION_STD_DEG,
)
from edgetree.measure.settings import MeasureSettings

_LEAST_OFFSET_M = 1e-6  # settings are positive

_EYE = np.eye(3)
_NAMES = {
    "scale": "depth_scale_std",
    "principal": "principal_std_px",
    "vertical": "vertical_std_deg",
    "mounting": "mounting_std_deg",
    "offset": "depth_offset_std_m",
}
_LARGEST = {
    "depth_scale_std": 0.5,
    "depth_offset_std_m": 1.0,
    "vertical_std_deg": 90.0,
    "mounting_std_deg": 90.0,
}


def _check(name: str, field: str, value: float) -> None:
    """Refuse a standard deviation that is out of range; `name` is what the user calls it."""
    largest = _LARGEST.get(field, math.inf)
    if not (math.isfinite(value) and 0 <= value <= largest):
        limit = f" to {largest:g}" if math.isfinite(largest) else " or more"
        raise InputError(f"the rig error {name} is {value:g}: expected 0{limit}")


@dataclass(frozen=True)
class RigUncertainty:
    """How well a rig is known, as standard deviations.

    A value that is None is not stated: that of the principal point is then the camera's
    `principal_std_px`, and the others, as this one without it, are those of
    `edgetree/measure/constants/rig.py`. The error of the focal length is the camera's
    `focal_std_px`.

    Attributes:
        depth_scale_std: Of the scale of the depth, as a share of it.
        principal_std_px: Of the principal point in x and in y, in px of the camera.
        vertical_std_deg: Of the given vertical, about each level axis.
        mounting_std_deg: Of the rotation from the camera to the machine, about each axis.
        depth_offset_std_m: Of the length that all depth is off by, as of a laser scanner. Where
            it is None, `MeasureSettings.depth_bias_m` holds.

    Raises:
        InputError: A value is negative, not finite or too large.

    Examples:
        >>> from edgetree.measure import RigUncertainty
        >>> careful = RigUncertainty(depth_scale_std=0.002, principal_std_px=0.8)
    """

    depth_scale_std: float | None = None
    principal_std_px: float | None = None
    vertical_std_deg: float | None = None
    mounting_std_deg: float | None = None
    depth_offset_std_m: float | None = None

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if value is not None:
                _check(entry.name, entry.name, value)

    @classmethod
    def from_text(cls, text: str) -> RigUncertainty:
        """Read values such as "scale=0.004,principal=1.2,vertical=0.5,mounting=1".

        Raises:
            InputError: A name is unknown or given twice, or a value is no number or out of range.
        """
        values: dict[str, float] = {}
        for part in text.split(","):
            name, _, number = part.partition("=")
            field = _NAMES.get(name.strip(), "")
            try:
                value = float(number)
            except ValueError:
                value = math.nan
            if not field or field in values or not math.isfinite(value):
                raise InputError(
                    f"the rig errors {text!r} hold {part.strip()!r}: expected NAME=NUMBER with each"
                    f" of {', '.join(_NAMES)} at most once, such as scale=0.004,principal=1.2"
                )
            _check(name.strip(), field, value)
            values[field] = value
        return cls(**values)

    def errors(self, camera: PinholeCamera) -> RigErrors:
        """The errors of this rig with a camera, those that nothing states at their defaults."""
        principal_px = _principal_px(self, camera)
        if principal_px is None:
            principal_px = PRINCIPAL_STD_SHARE * camera.width
        return RigErrors(
            scale=_or_default(self.depth_scale_std, DEPTH_SCALE_STD),
            ray=principal_px / camera.fx,
            focal=camera.focal_std_px / camera.fx,
            vertical_rad=math.radians(_or_default(self.vertical_std_deg, ROTATION_STD_DEG)),
            mounting_rad=math.radians(_or_default(self.mounting_std_deg, ROTATION_STD_DEG)),
        )

    def in_settings(self, settings: MeasureSettings) -> MeasureSettings:
        """The settings with the offset of the depth, if it is stated: all readings share it."""
        if self.depth_offset_std_m is None:
            return settings
        return replace(settings, depth_bias_m=max(self.depth_offset_std_m, _LEAST_OFFSET_M))

    def assumed(self, camera: PinholeCamera, has_vertical: bool, has_mounting: bool) -> list[str]:
        """What is assumed as nothing states it, each in a few words.

        Args:
            camera: The camera.
            has_vertical: Whether a vertical is given, or follows from a mounting.
            has_mounting: Whether a mounting is given.
        """
        words = []
        if self.depth_scale_std is None:
            words.append(f"depth scale {100 * DEPTH_SCALE_STD:g} %")
        if _principal_px(self, camera) is None:
            words.append(f"principal point {PRINCIPAL_STD_SHARE * camera.width:.1f} px")
        if has_vertical and self.vertical_std_deg is None:
            words.append(f"vertical {ROTATION_STD_DEG:g} degrees")
        if has_mounting and self.mounting_std_deg is None:
            words.append(f"mounting {ROTATION_STD_DEG:g} degrees")
        return words


EXACT_RIG = RigUncertainty(0.0, 0.0, 0.0, 0.0)
"""A rig without errors, as of a simulator."""


@dataclass(frozen=True)
class RigErrors:
    """Standard deviations of a rig's errors.

    A point (x, y, z) of the camera's frame comes out at (1 + s) (x + p z + g x, y + q z + g y, z):
    s is the error of the depth's scale, p and q are those of the principal point over the focal
    length, and g is that of the focal length.

    Attributes:
        scale: Of s.
        ray: Of p and q.
        focal: Of g.
        vertical_rad: Of the given vertical, about each level axis.
        mounting_rad: Of the rotation to the machine, about each axis.
        placed: Whether stems are placed without depth, which states the errors of sizes itself.
    """

    scale: float
    ray: float
    focal: float
    vertical_rad: float
    mounting_rad: float
    placed: bool = False

    @cached_property
    def size_std(self) -> float:
        """Relative standard deviation of lengths across the view, such as diameters."""
        if self.placed:
            return 0.0
        return math.hypot(self.scale, self.focal)

    def std_m(self, vector: Float, direction: Float) -> float:
        """Standard deviation of a (3,) vector's component in a (3,) unit direction, in metres.

        The vector leads from one point of the scene to another, or from the camera to one.
        """
        (x, y, z), (a, b, c) = vector.tolist(), direction.tolist()
        flat = a * x + b * y
        parts = (self.scale * (flat + c * z), self.ray * z * a, self.ray * z * b)
        return math.hypot(*parts, self.focal * flat)

    def covariance(self, vector: Float) -> Float:
        """(3, 3) covariance of the error of such a (3,) vector, in m²."""
        x, y, z = vector.tolist()
        s, p, g = self.scale, self.ray * z, self.focal
        parts = np.array([[s * x, p, 0.0, g * x], [s * y, 0.0, p, g * y], [s * z, 0.0, 0.0, 0.0]])
        return np.asarray(parts @ parts.T)

    def direction_covariance(self, direction: Float) -> Float:
        """(3, 3) covariance of a (3,) unit direction, in rad²: what turns it, not its length."""
        level = _EYE - direction[:, None] * direction
        return np.asarray(level @ self.covariance(direction) @ level)

    def vertical_covariance(self, up: Float) -> Float:
        """(3, 3) covariance of a given vertical (3,) relative to stems along it, in rad²."""
        level = np.eye(3) - np.outer(up, up)
        return self.vertical_rad**2 * level + self.direction_covariance(up)

    def turned_covariance(self, point_m: Float) -> Float:
        """(3, 3) covariance of a point (3,), from the camera, by the mounting's rotation, m²."""
        squared = float(point_m @ point_m)
        return np.asarray(self.mounting_rad**2 * (squared * np.eye(3) - np.outer(point_m, point_m)))


@dataclass(frozen=True, eq=False, kw_only=True)
class TurnedErrors(RigErrors):
    """Those of a rig in a view that is turned from its camera; vectors are in the camera's axes.

    Attributes:
        rotation: (3, 3) from the camera's axes to the view's, in which the errors are those of
            `RigErrors`.
    """

    rotation: Float

    def std_m(self, vector: Float, direction: Float) -> float:
        """As of `RigErrors`."""
        return super().std_m(self.rotation @ vector, self.rotation @ direction)

    def covariance(self, vector: Float) -> Float:
        """As of `RigErrors`."""
        own = super().covariance(self.rotation @ vector)
        return np.asarray(self.rotation.T @ own @ self.rotation)


NO_ERRORS = RigErrors(0.0, 0.0, 0.0, 0.0, 0.0)
"""Those of a rig that is exact."""


def _principal_px(rig: RigUncertainty, camera: PinholeCamera) -> float | None:
    """Standard deviation of the principal point; None if neither rig nor camera states it."""
    return camera.principal_std_px if rig.principal_std_px is None else rig.principal_std_px


def _or_default(value: float | None, default: float) -> float:
    return default if value is None else value
