"""Check that a lens with a camera's parameters can exist, and name what is unusual about it.

Wrong parameters, such as focal lengths in millimetres or as shares of the width, give wrong metres
without any other sign.
"""

from __future__ import annotations

import copy
import math
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from calib.distortion import distort, undistort
from calib.errors import CameraError
from calib.lens_models import FISHEYE, RADTAN

if TYPE_CHECKING:
    from calib.camera import PinholeCamera

_LARGEST_PX = 100_000
# Fields of view of any lens, and of usual ones
_WIDEST_DEG = {RADTAN: 156.0, FISHEYE: 280.0}
_USUALLY_WIDEST_DEG = {RADTAN: 125.0, FISHEYE: 220.0}
_NARROWEST_DEG, _USUALLY_NARROWEST_DEG = 0.1, 5.0
_MAX_ASPECT, _USUAL_ASPECT = 4.0, 1.1  # of pixels: fx / fy, or fy / fx
# Distance of the principal point from the image's centre, in widths and heights
_FARTHEST_CENTRE, _USUALLY_FARTHEST_CENTRE = 1.0, 0.2
_MIN_INVERTIBLE = {RADTAN: 0.75, FISHEYE: 0.25}  # the corners of fisheye images show nothing
_MAX_LENS_RATIO = 4.0
_MAX_ERROR_PX = 0.5
_GRID, _RADII = 16, 200
_TINY = 1e-6


class _Lens(NamedTuple):
    """How a distortion acts over the image.

    Attributes:
        invertible: Share of the image whose pixels have one ray.
        ratio: Largest ratio of radii with and without the distortion, or its inverse, at least 1.
    """

    invertible: float
    ratio: float


def check_size(width: int, height: int) -> None:
    """Check an image size.

    Raises:
        CameraError: If a side is below 1 or above 100,000 px.
    """
    if width < 1 or height < 1:
        raise CameraError(f"image size is {width}x{height}: expected at least 1x1")
    if max(width, height) > _LARGEST_PX:
        raise CameraError(
            f"image size is {width}x{height}: expected at most {_LARGEST_PX} px on each side"
        )


def check_camera(camera: PinholeCamera) -> None:
    """Check that a lens with these parameters can exist.

    Raises:
        CameraError: If the field of view is beyond that of any lens, pixels are not nearly square,
            the principal point is far outside the image, or the distortion cannot be inverted.
    """
    model = camera.distortion_model
    view_deg = _view_deg(camera)
    if not _NARROWEST_DEG <= view_deg <= _WIDEST_DEG[model]:
        raise CameraError(
            f"fx is {camera.fx:g} and fy {camera.fy:g} for {camera.width}x{camera.height} px, a"
            f" field of view of {view_deg:.3g} degrees: expected {_NARROWEST_DEG:g} to"
            f" {_WIDEST_DEG[model]:g} of a {model} lens, with fx and fy in pixels"
        )
    if _aspect(camera) > _MAX_ASPECT:
        raise CameraError(
            f"fx is {camera.fx:g} and fy {camera.fy:g}: expected nearly the same, or a ratio of at"
            f" most {_MAX_ASPECT:g}"
        )
    for name, value, size in (("cx", camera.cx, camera.width), ("cy", camera.cy, camera.height)):
        if abs(value + 0.5 - size / 2) > _FARTHEST_CENTRE * size:
            raise CameraError(
                f"{name} is {value}: expected a point near the image, {size} px: from"
                f" {-size / 2:g} to {3 * size / 2:g}"
            )
    if any(camera.distortion):
        _check_lens(camera, _lens(camera))


def _check_lens(camera: PinholeCamera, lens: _Lens) -> None:
    if lens.invertible < _MIN_INVERTIBLE[camera.distortion_model]:
        raise CameraError(
            f"distortion is {camera.distortion}, which gives one ray for only"
            f" {100 * lens.invertible:.0f} % of the image: expected a {camera.distortion_model}"
            f" lens that does not fold it over, at least"
            f" {100 * _MIN_INVERTIBLE[camera.distortion_model]:.0f} %"
        )
    if lens.ratio > _MAX_LENS_RATIO:
        raise CameraError(
            f"distortion is {camera.distortion}, which moves points {lens.ratio:.3g} times closer"
            f" to the centre or farther from it: expected at most {_MAX_LENS_RATIO:g} times"
        )


def unusual_values(camera: PinholeCamera) -> tuple[str, ...]:
    """Return one line for each value that lenses can have but seldom do."""
    found = []
    widest_deg, view_deg = _USUALLY_WIDEST_DEG[camera.distortion_model], _view_deg(camera)
    if not _USUALLY_NARROWEST_DEG <= view_deg <= widest_deg:
        found.append(
            f"the field of view is {view_deg:.3g} degrees, usual are {_USUALLY_NARROWEST_DEG:g} to"
            f" {widest_deg:g}"
        )
    if _aspect(camera) > _USUAL_ASPECT:
        found.append(f"fx is {camera.fx:g} and fy {camera.fy:g}, usual are nearly equal values")
    for name, value, size in (("cx", camera.cx, camera.width), ("cy", camera.cy, camera.height)):
        if abs(value + 0.5 - size / 2) > _USUALLY_FARTHEST_CENTRE * size:
            found.append(f"{name} is {value:g}, usual are values near {size / 2:g}")
    if camera.distortion_model == RADTAN and any(camera.distortion):
        invertible = _lens(camera).invertible
        if invertible < 1:
            found.append(
                f"the distortion folds {100 * (1 - invertible):.0f} % of the image over, where"
                " nothing can be measured"
            )
    return tuple(found)


def _view_deg(camera: PinholeCamera) -> float:
    """Return the field of view in degrees, as if the centre were the image's.

    Without the distortion; across the longer side, for a fisheye lens across the shorter one, which
    its round picture may fill.
    """
    halves = (camera.width / (2 * camera.fx), camera.height / (2 * camera.fy))
    if camera.distortion_model == FISHEYE:
        return math.degrees(2 * min(halves))
    return math.degrees(2 * math.atan(max(halves)))


def _aspect(camera: PinholeCamera) -> float:
    return max(camera.fx / camera.fy, camera.fy / camera.fx)


@lru_cache(maxsize=256)
def _lens(camera: PinholeCamera) -> _Lens:
    """Distort what was undistorted at a grid of pixels, and compare."""
    middles = (np.arange(_GRID) + 0.5) / _GRID
    columns, rows = np.meshgrid(middles * camera.width - 0.5, middles * camera.height - 0.5)
    x, y = (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy
    with np.errstate(all="ignore"):
        u, v = undistort(camera, x, y)
        again_x, again_y = distort(camera, u, v)
        error_px = np.hypot((again_x - x) * camera.fx, (again_y - y) * camera.fy)
        radius, plain = np.hypot(x, y), np.hypot(u, v)
        invertible = (error_px < _MAX_ERROR_PX) & (plain < _fold_radius(camera, plain.max()))
        if camera.distortion_model == FISHEYE:
            plain = np.arctan(plain)
        ratios = (plain / radius)[invertible & (radius > _TINY)]
    ratio = max(ratios.max(initial=1.0), 1 / max(ratios.min(initial=1.0), _TINY))
    return _Lens(float(invertible.mean()), float(ratio))


def _fold_radius(camera: PinholeCamera, farthest: float) -> float:
    """Return the undistorted radius from which on the distorted radius no longer grows."""
    radii = np.linspace(0, farthest, _RADII)
    radial = camera.distortion
    if camera.distortion_model == RADTAN:  # without the tangential terms
        radial = (*radial[:2], 0.0, 0.0, *radial[4:])
    straight = copy.copy(camera)
    object.__setattr__(straight, "distortion", radial)
    distorted, _ = distort(straight, radii, np.zeros_like(radii))
    falling = np.flatnonzero(~(np.diff(distorted) > 0))
    return float(radii[falling[0]]) if len(falling) else math.inf
