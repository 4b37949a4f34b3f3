"""Cameras in ROS parameter files: an image size and a map named after the model, with K and D."""

from __future__ import annotations

from collections.abc import Mapping

from calib.camera import PinholeCamera
from calib.distortion import FISHEYE, RADTAN
from calib.errors import CameraError
from calib.files.fields import Values, camera, lens_model, matrix, numbers, size

_MODELS = {"fisheye": FISHEYE, "equidistant": FISHEYE, "radtan": RADTAN, "plumb_bob": RADTAN}


def find(values: Values) -> dict[str, Values]:
    """Return every map, at any depth, that has an image size and a lens."""
    found: dict[str, Values] = {}
    for name, inner in values.items():
        if isinstance(inner, Mapping):
            is_camera = "image_width" in inner and _lenses(inner)
            found.update({str(name): inner} if is_camera else find(inner))
    return found


def _lenses(values: Values) -> list[str]:
    """Return the names of the maps with K and D."""
    return [
        name
        for name, lens in values.items()
        if isinstance(lens, Mapping) and "K" in lens and "D" in lens
    ]


def build(values: Values) -> PinholeCamera:
    """Create the camera for the image size in the file; use ``scaled`` for other sizes."""
    lenses = _lenses(values)
    if len(lenses) > 1:
        raise CameraError(f"{' and '.join(lenses)} both hold K and D: expected one lens")
    lens = values[lenses[0]]
    model = lens_model("the lens", lenses[0], _MODELS)
    return camera(size(values), matrix(lens, "K"), numbers(lens, "D"), model)
