"""Check that a lens with a camera's parameters can exist, and name what is unusual about it.

Wrong parameters, such as focal lengths in millimetres or as shares of the width, give wrong metres
without any other sign.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from calib.distortion import FISHEYE, RADTAN, Lens, distort, undistort
from calib.errors import CameraError

LARGEST_PX: Final = 100_000
# Fields of view of any lens, and of usual ones
_WIDEST_DEG = {RADTAN: 156.0, FISHEYE: 280.0}
_USUALLY_WIDEST_DEG = {RADTAN: 125.0, FISHEYE: 220.0}
_NARROWEST_DEG, _USUALLY_NARROWEST_DEG = 0.1, 5.0
_MAX_ASPECT, _USUAL_ASPECT = 4.0, 1.1  # of pixels: fx / fy, or fy / fx
# Distance of the principal point from the image's centre, in widths and heights
_FARTHEST_CENTRE, _USUALLY_FARTHEST_CENTRE = 1.0, 0.2
_MIN_INVERTIBLE = {RADTAN: 0.75, FISHEYE: 0.25}  # the corners of fisheye images show nothing
_MAX_LENS_RATIO = 4.0
_MOST_TILT_DEG = 45.0  # of a sensor: the two terms after the twelve of lens and prism
_MAX_ERROR_PX = 0.5
_GRID, _RADII = 16, 200
_TINY = 1e-6


class Intrinsics(NamedTuple):
    """Size, focal lengths and principal point of a camera in px, and its lens."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    lens: Lens

    @property
    def view_deg(self) -> float:
        """Field of view in degrees, as if the centre were the image's.

        Without the distortion; across the longer side, for a fisheye lens across the shorter one,
        which its round picture may fill.
        """
        halves = (self.width / (2 * self.fx), self.height / (2 * self.fy))
        if self.lens.model == FISHEYE:
            return math.degrees(2 * min(halves))
        return math.degrees(2 * math.atan(max(halves)))

    @property
    def aspect(self) -> float:
        """Ratio of the focal lengths, at least 1."""
        return max(self.fx / self.fy, self.fy / self.fx)

    def centres_beyond(self, share: float) -> list[tuple[str, float, int]]:
        """Coordinates of the principal point farther off the middle than a share of the side.

        Returns:
            The name of each, its value, and the side.
        """
        both = (("cx", self.cx, self.width), ("cy", self.cy, self.height))
        return [each for each in both if abs(each[1] + 0.5 - each[2] / 2) > share * each[2]]


class _Effect(NamedTuple):
    """How a distortion acts over the image.

    Attributes:
        invertible: Share of the image whose pixels have one ray.
        ratio: Largest ratio of radii with and without the distortion, or its inverse, at least 1.
    """

    invertible: float
    ratio: float


def whole_size(width: float, height: float) -> tuple[int, int]:
    """Check an image size, and return its sides as int.

    Raises:
        CameraError: If a side is no whole number, below 1 or above 100,000 px.
    """
    if not all(math.isfinite(side) and side == int(side) for side in (width, height)):
        raise CameraError(f"image size is {width}x{height}: expected whole numbers of px")
    width, height = int(width), int(height)
    if width < 1 or height < 1:
        raise CameraError(f"image size is {width}x{height}: expected at least 1x1")
    if max(width, height) > LARGEST_PX:
        raise CameraError(
            f"image size is {width}x{height}: expected at most {LARGEST_PX} px on each side"
        )
    return width, height


def check_camera(camera: Intrinsics) -> None:
    """Check that a lens with these parameters can exist.

    Raises:
        CameraError: If the field of view is beyond that of any lens, pixels are not nearly square,
            the principal point is far outside the image, or the distortion cannot be inverted.
    """
    model = camera.lens.model
    if not _NARROWEST_DEG <= camera.view_deg <= _WIDEST_DEG[model]:
        raise CameraError(
            f"fx is {camera.fx:g} and fy {camera.fy:g} for {camera.width}x{camera.height} px, a"
            f" field of view of {camera.view_deg:.3g} degrees: expected {_NARROWEST_DEG:g} to"
            f" {_WIDEST_DEG[model]:g} of a {model} lens, with fx and fy in pixels"
        )
    if camera.aspect > _MAX_ASPECT:
        raise CameraError(
            f"fx is {camera.fx:g} and fy {camera.fy:g}: expected nearly the same, or a ratio of at"
            f" most {_MAX_ASPECT:g}"
        )
    for name, value, size in camera.centres_beyond(_FARTHEST_CENTRE):
        raise CameraError(
            f"{name} is {value}: expected a point near the image, {size} px: from"
            f" {-size / 2:g} to {3 * size / 2:g}"
        )
    tilt_deg = max((abs(math.degrees(tau)) for tau in camera.lens.terms[12:]), default=0.0)
    if tilt_deg > _MOST_TILT_DEG:
        raise CameraError(
            f"the sensor is tilted by {tilt_deg:.3g} degrees, by the last terms of"
            f" {camera.lens.terms}: expected at most {_MOST_TILT_DEG:g}"
        )
    if any(camera.lens.terms):
        _check_effect(camera.lens, _effect(camera))


def _check_effect(lens: Lens, found: _Effect) -> None:
    if found.invertible < _MIN_INVERTIBLE[lens.model]:
        raise CameraError(
            f"distortion is {lens.terms}, which gives one ray for only"
            f" {100 * found.invertible:.0f} % of the image: expected a {lens.model}"
            f" lens that does not fold it over, at least"
            f" {100 * _MIN_INVERTIBLE[lens.model]:.0f} %"
        )
    if found.ratio > _MAX_LENS_RATIO:
        raise CameraError(
            f"distortion is {lens.terms}, which moves points {found.ratio:.3g} times closer"
            f" to the centre or farther from it: expected at most {_MAX_LENS_RATIO:g} times"
        )


def unusual_values(camera: Intrinsics) -> tuple[str, ...]:
    """Return one line for each value that lenses can have but seldom do."""
    found = []
    widest_deg = _USUALLY_WIDEST_DEG[camera.lens.model]
    if not _USUALLY_NARROWEST_DEG <= camera.view_deg <= widest_deg:
        found.append(
            f"the field of view is {camera.view_deg:.3g} degrees, usual are"
            f" {_USUALLY_NARROWEST_DEG:g} to {widest_deg:g}"
        )
    if camera.aspect > _USUAL_ASPECT:
        found.append(f"fx is {camera.fx:g} and fy {camera.fy:g}, usual are nearly equal values")
    for name, value, size in camera.centres_beyond(_USUALLY_FARTHEST_CENTRE):
        found.append(f"{name} is {value:g}, usual are values near {size / 2:g}")
    if camera.lens.model == RADTAN and any(camera.lens.terms):
        invertible = _effect(camera).invertible
        if invertible < 1:
            found.append(
                f"the distortion folds {100 * (1 - invertible):.0f} % of the image over, where"
                " nothing can be measured"
            )
    return tuple(found)


@lru_cache(maxsize=256)
def _effect(camera: Intrinsics) -> _Effect:
    """Distort what was undistorted at a grid of pixels, and compare."""
    middles = (np.arange(_GRID) + 0.5) / _GRID
    columns, rows = np.meshgrid(middles * camera.width - 0.5, middles * camera.height - 0.5)
    x, y = (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy
    with np.errstate(all="ignore"):
        u, v = undistort(camera.lens, x, y)
        again_x, again_y = distort(camera.lens, u, v)
        error_px = np.hypot((again_x - x) * camera.fx, (again_y - y) * camera.fy)
        radius, plain = np.hypot(x, y), np.hypot(u, v)
        invertible = (error_px < _MAX_ERROR_PX) & (plain < _fold_radius(camera.lens, plain.max()))
        if camera.lens.model == FISHEYE:
            plain = np.arctan(plain)
        ratios = (plain / radius)[invertible & (radius > _TINY)]
    ratio = max(ratios.max(initial=1.0), 1 / max(ratios.min(initial=1.0), _TINY))
    return _Effect(float(invertible.mean()), float(ratio))


def _fold_radius(lens: Lens, farthest: float) -> float:
    """Return the undistorted radius from which on the distorted radius no longer grows."""
    radii = np.linspace(0, farthest, _RADII)
    if lens.model == RADTAN:  # without the tangential terms, thin prisms and the sensor's tilt
        lens = Lens(RADTAN, (*lens.terms[:2], 0.0, 0.0, *lens.terms[4:8]))
    distorted, _ = distort(lens, radii, np.zeros_like(radii))
    falling = np.flatnonzero(~(np.diff(distorted) > 0))
    return float(radii[falling[0]]) if len(falling) else math.inf
