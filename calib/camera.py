"""A pinhole camera with radial-tangential distortion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from calib.errors import CameraError

_ASPECT_TOLERANCE = 0.01
_DISTORTION_TERMS = (0, 4, 5)


@dataclass(frozen=True)
class PinholeCamera:
    """Intrinsics of an image of ``width`` x ``height`` px.

    ``fx``, ``fy``, ``cx``, ``cy`` in px follow OpenCV: pixel centres on whole numbers.
    ``distortion`` holds none, four or five terms k1, k2, p1, p2, k3 of OpenCV's model.
    Raises CameraError for values that no camera has.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise CameraError(f"image size is {self.width}x{self.height}: expected at least 1x1")
        for name in ("fx", "fy"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise CameraError(f"{name} is {getattr(self, name)}: expected a positive number")
        for name, size in (("cx", self.width), ("cy", self.height)):
            value = getattr(self, name)
            if not (math.isfinite(value) and -size <= value <= 2 * size):
                raise CameraError(f"{name} is {value}: expected a point near the image, {size} px")
        object.__setattr__(self, "distortion", tuple(float(k) for k in self.distortion))
        if len(self.distortion) not in _DISTORTION_TERMS:
            raise CameraError(
                f"distortion has {len(self.distortion)} terms: expected none, 4 (k1 k2 p1 p2)"
                " or 5 (k1 k2 p1 p2 k3)"
            )
        if not all(math.isfinite(k) for k in self.distortion):
            raise CameraError(f"distortion is {self.distortion}: expected finite numbers")

    def scaled(self, width: int, height: int) -> PinholeCamera:
        """The same camera for the image resized to ``width`` x ``height``.

        With scale s, cx becomes s (cx + 0.5) - 0.5. Raises CameraError where the aspect changes
        by more than 1 %: then the image was cropped and the intrinsics do not follow.
        """
        if width < 1 or height < 1:
            raise CameraError(f"image size is {width}x{height}: expected at least 1x1")
        sx, sy = width / self.width, height / self.height
        if abs(sx / sy - 1) > _ASPECT_TOLERANCE:
            raise CameraError(
                f"the camera is for {self.width}x{self.height} px and the image is"
                f" {width}x{height}: expected the same aspect"
            )
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=sx * (self.cx + 0.5) - 0.5,
            cy=sy * (self.cy + 0.5) - 0.5,
        )

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {**asdict(self), "distortion": list(self.distortion)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> PinholeCamera:
        """From ``to_dict``'s values; raises CameraError for what is missing or not a number."""
        numbers: dict[str, float] = {}
        for name in ("width", "height", "fx", "fy", "cx", "cy"):
            value = values.get(name)
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise CameraError(f"camera field {name} is {value!r}: expected a number")
            numbers[name] = value
        for name in ("width", "height"):
            if numbers[name] != int(numbers[name]):
                raise CameraError(f"camera field {name} is {numbers[name]}: expected whole pixels")
        distortion = values.get("distortion", ())
        if not isinstance(distortion, list | tuple) or not all(
            isinstance(k, int | float) for k in distortion
        ):
            raise CameraError(f"camera field distortion is {distortion!r}: expected numbers")
        return cls(
            int(numbers["width"]), int(numbers["height"]), float(numbers["fx"]),
            float(numbers["fy"]), float(numbers["cx"]), float(numbers["cy"]), tuple(distortion),
        )  # fmt: skip
