"""Pinhole camera with Brown-Conrady ("radtan") or Kannala-Brandt ("fisheye") distortion."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

from calib.distortion import FISHEYE, RADTAN, Lens
from calib.errors import CameraError
from calib.plausibility import Intrinsics, check_camera, unusual_values, whole_size

_ASPECT_TOLERANCE = 0.01
_NUMBERS = ("fx", "fy", "cx", "cy", "focal_std_px")
_TERM_COUNTS = {RADTAN: (0, 4, 5, 8, 12, 14), FISHEYE: (4,)}
_TERM_NAMES = {
    RADTAN: "none, 4 (k1 k2 p1 p2), 5 (and k3), 8 (and k4 k5 k6), 12 (and s1 s2 s3 s4) or 14 (and"
    " tau x, tau y)",
    FISHEYE: "4 (k1 k2 k3 k4)",
}


@dataclass(frozen=True)
class PinholeCamera:
    """Intrinsics and distortion of a camera.

    The parameters follow OpenCV, where a pixel's centre has whole-number coordinates.
    `calib.pixels` converts to the continuous pixels used elsewhere.

    Attributes:
        width: Image width in px.
        height: Image height in px.
        fx: Focal length along x in px.
        fy: Focal length along y in px.
        cx: Principal point's x in px, OpenCV's convention.
        cy: Principal point's y in px, OpenCV's convention.
        distortion: Distortion coefficients in OpenCV's order: none, 4, 5, 8, 12 or 14 of k1, k2,
            p1, p2, k3, k4, k5, k6, s1 to s4 (thin prism), tau x and tau y (tilted sensor, rad)
            for "radtan"; k1, k2, k3, k4 for "fisheye".
        distortion_model: "radtan" (Brown-Conrady, as `cv2.projectPoints`) or "fisheye"
            (Kannala-Brandt, as `cv2.fisheye`).
        focal_std_px: Standard deviation of fx and fy in px; 0 if unknown.
        principal_std_px: Standard deviation of cx and cy in px; None if it is not stated.

    Raises:
        CameraError: If a value is out of range or not finite, or if no lens has these parameters:
            a field of view above 156 degrees (fisheye: 280) or below 0.1, a principal point more
            than half the image outside of it, or a distortion that folds the image over.

    Examples:
        >>> from calib import PinholeCamera
        >>> camera = PinholeCamera(1280, 720, fx=698.4, fy=698.4, cx=639.5, cy=359.5)
        >>> camera.scaled(640, 360).fx
        349.2
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    distortion_model: str = RADTAN
    focal_std_px: float = 0.0
    principal_std_px: float | None = None

    def __post_init__(self) -> None:
        width, height = whole_size(self.width, self.height)
        for name in ("fx", "fy"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise CameraError(f"{name} is {getattr(self, name)}: expected a positive number")
        for name, size in (("cx", self.width), ("cy", self.height)):
            value = getattr(self, name)
            if not math.isfinite(value):
                raise CameraError(f"{name} is {value}: expected a point near the image, {size} px")
        object.__setattr__(self, "distortion", tuple(float(k) for k in self.distortion))
        if self.distortion_model not in _TERM_COUNTS:
            raise CameraError(
                f"distortion_model is {self.distortion_model!r}: expected {RADTAN} or {FISHEYE}"
            )
        if len(self.distortion) not in _TERM_COUNTS[self.distortion_model]:
            raise CameraError(
                f"distortion has {len(self.distortion)} terms: expected"
                f" {_TERM_NAMES[self.distortion_model]} of the {self.distortion_model} model"
            )
        if not all(math.isfinite(k) for k in self.distortion):
            raise CameraError(f"distortion is {self.distortion}: expected finite numbers")
        if not 0 <= self.focal_std_px < min(self.fx, self.fy):
            raise CameraError(
                f"focal_std_px is {self.focal_std_px}: expected 0 or more, and less than fx and fy"
            )
        std_px, size_px = self.principal_std_px, max(self.width, self.height)
        if std_px is not None and not 0 <= std_px < size_px:
            raise CameraError(
                f"principal_std_px is {std_px}: expected 0 or more, and less than the image"
            )
        numbers = {name: float(getattr(self, name)) for name in _NUMBERS}  # also those of numpy
        std_px = None if std_px is None else float(std_px)
        self._set(width=width, height=height, principal_std_px=std_px, **numbers)
        check_camera(self._intrinsics)

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def has_size(self) -> bool:
        """Whether `width` and `height` are known, and not guessed as for files without them."""
        return True

    @property
    def lens(self) -> Lens:
        """The distortion."""
        return Lens(self.distortion_model, self.distortion)

    @property
    def _intrinsics(self) -> Intrinsics:
        return Intrinsics(self.width, self.height, self.fx, self.fy, self.cx, self.cy, self.lens)

    def unusual_values(self) -> tuple[str, ...]:
        """Return one line for each value that lenses can have but seldom do.

        `load_camera` logs them as warnings.
        """
        return unusual_values(self._intrinsics)

    def _changed(self, **values: Any) -> PinholeCamera:
        """Return a copy with other values, for values that follow from those of this camera."""
        other = copy.copy(self)
        other._set(**values)
        return other

    def scaled(self, width: int, height: int) -> PinholeCamera:
        """Return the camera of the image resized to `width` x `height` px.

        Pixel centres are at whole numbers, so a scale s moves cx to s (cx + 0.5) - 0.5.

        Raises:
            CameraError: If the size is not whole, below 1x1 or too large, or the aspect ratio
                changes by more than 1 %: the image was cropped, and scaling would be wrong.
        """
        width, height = whole_size(width, height)
        sx, sy = width / self.width, height / self.height
        if abs(sx / sy - 1) > _ASPECT_TOLERANCE:
            raise CameraError(
                f"the camera is for {self.width}x{self.height} px and the image is"
                f" {width}x{height}: expected the same aspect ratio"
            )
        return self._changed(
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=sx * (self.cx + 0.5) - 0.5,
            cy=sy * (self.cy + 0.5) - 0.5,
            focal_std_px=self.focal_std_px * sx,
            principal_std_px=self._principal_std_px(sx),
        )

    def _principal_std_px(self, scale: float) -> float | None:
        return None if self.principal_std_px is None else self.principal_std_px * scale

    def cropped(self, x_px: int, y_px: int, width: int, height: int) -> PinholeCamera:
        """Return the camera of a crop of the image.

        Args:
            x_px: Column of the crop's first pixel.
            y_px: Row of the crop's first pixel.
            width: Width of the crop in px.
            height: Height of the crop in px.

        Raises:
            CameraError: If the crop is not inside the image.
        """
        inside = x_px >= 0 and y_px >= 0 and width >= 1 and height >= 1
        if not inside or x_px + width > self.width or y_px + height > self.height:
            raise CameraError(
                f"the crop is {width}x{height} px at ({x_px}, {y_px}): expected one inside the"
                f" camera's {self.width}x{self.height}"
            )
        return self._changed(width=width, height=height, cx=self.cx - x_px, cy=self.cy - y_px)

    def rotated(self, clockwise_deg: int) -> PinholeCamera:
        """Return the camera of the image turned clockwise.

        Camera coordinates turn about the optical axis: after 90 degrees, x and y of a point are
        -y and x.

        Args:
            clockwise_deg: 0, 90, 180 or 270.

        Raises:
            CameraError: If it is another angle, or the lens is tilted and turned by 90 or 270.
        """
        if clockwise_deg not in (0, 90, 180, 270):
            raise CameraError(f"clockwise_deg is {clockwise_deg}: expected 0, 90, 180 or 270")
        tilt_rad = self.distortion[12:]
        if any(tilt_rad) and clockwise_deg not in (0, 180):
            raise CameraError(
                f"the lens is tilted by {tilt_rad} rad: expected none, as an image is turned by"
                f" {clockwise_deg} degrees"
            )
        camera = self
        for _ in range(clockwise_deg // 90):
            camera = camera._changed(
                width=camera.height,
                height=camera.width,
                fx=camera.fy,
                fy=camera.fx,
                cx=camera.height - 1 - camera.cy,
                cy=camera.cx,
                distortion=_quarter_turned(camera.distortion, camera.distortion_model),
            )
        return camera

    def binned(self, columns: int, rows: int) -> PinholeCamera:
        """Return the camera of images whose pixels are `columns` x `rows` pixels of this one.

        What is left at the right and lower edge is cut off.

        Raises:
            CameraError: If a number is below 1, or larger than the image.
        """
        width, height = self.width // max(columns, 1), self.height // max(rows, 1)
        if min(columns, rows, width, height) < 1:
            raise CameraError(
                f"binning is {columns}x{rows}: expected 1x1 or more, and at most the image of"
                f" {self.width}x{self.height} px"
            )
        return self._changed(
            width=width,
            height=height,
            fx=self.fx / columns,
            fy=self.fy / rows,
            cx=(self.cx + 0.5) / columns - 0.5,
            cy=(self.cy + 0.5) / rows - 0.5,
            focal_std_px=self.focal_std_px / columns,
            principal_std_px=self._principal_std_px(1 / columns),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values; optional fields are left out at their defaults."""
        values = {**asdict(self), "distortion": list(self.distortion)}
        if self.distortion_model == RADTAN:
            del values["distortion_model"]
        if self.focal_std_px == 0:
            del values["focal_std_px"]
        if self.principal_std_px is None:
            del values["principal_std_px"]
        return values

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> PinholeCamera:
        """Create a camera from the values of `to_dict`.

        Raises:
            CameraError: If a field is missing or has the wrong type.
        """
        width, height, fx, fy, cx, cy = (
            _number(name, values.get(name)) for name in ("width", "height", "fx", "fy", "cx", "cy")
        )
        for name, size in (("width", width), ("height", height)):
            if not math.isfinite(size) or size != int(size):
                raise CameraError(f"camera field {name} is {size}: expected whole pixels")
        distortion = values.get("distortion", ())
        if not isinstance(distortion, list | tuple):
            raise CameraError(f"camera field distortion is {distortion!r}: expected numbers")
        principal_std_px = values.get("principal_std_px")
        return cls(
            int(width),
            int(height),
            fx,
            fy,
            cx,
            cy,
            tuple(_number("distortion", k) for k in distortion),
            str(values.get("distortion_model", RADTAN)),
            _number("focal_std_px", values.get("focal_std_px", 0.0)),
            None if principal_std_px is None else _number("principal_std_px", principal_std_px),
        )


def _number(name: str, value: Any) -> float:
    """Return a field as float; integers too large for a float are rejected."""
    if not isinstance(value, bool) and isinstance(value, int | float):
        with suppress(OverflowError):
            return float(value)
    raise CameraError(f"camera field {name} is {value!r}: expected a number")


def _quarter_turned(terms: tuple[float, ...], model: str) -> tuple[float, ...]:
    """The terms after a quarter turn clockwise: radial ones stay, directed ones turn along.

    The tangential terms are the vector (p2, p1), the thin prism's (s1, s3) and (s2, s4). A vector
    (x, y) becomes (-y, x). The angles of a tilted lens are right after two quarter turns alone.
    """
    if model != RADTAN or len(terms) < 4:
        return terms
    k1, k2, p1, p2, *others = terms
    radial, prism, tilt = others[:4], others[4:8], others[8:]
    if prism:
        s1, s2, s3, s4 = prism
        prism = [-s3, -s4, s1, s2]
    if tilt:
        tilt = [-tilt[1], tilt[0]]
    return (k1, k2, p2, -p1, *radial, *prism, *tilt)
