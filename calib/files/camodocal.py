"""Camera YAML of CamOdoCal and VINS: models PINHOLE and KANNALA_BRANDT."""

from __future__ import annotations

from collections.abc import Mapping

from calib.camera import PinholeCamera
from calib.distortion import FISHEYE
from calib.errors import CameraError
from calib.files.fields import Values, camera, number, size


def find(values: Values) -> dict[str, Values]:
    """Return the camera if the values have a model type and projection parameters."""
    known = "model_type" in values and "projection_parameters" in values
    return {str(values.get("camera_name", "")): values} if known else {}


def build(values: Values) -> PinholeCamera:
    """Create the camera.

    KANNALA_BRANDT's k2 to k5 multiply the powers 3, 5, 7, 9 of the angle: OpenCV's k1 to k4.
    """
    kind = values["model_type"]
    projection = _group(values, "projection_parameters")
    if kind == "PINHOLE":
        lens = _group(values, "distortion_parameters")
        terms = [number(lens, name) for name in ("k1", "k2", "p1", "p2")]
        focal = [number(projection, name) for name in ("fx", "fy", "cx", "cy")]
        return camera(size(values), focal, terms)
    if kind == "KANNALA_BRANDT":
        terms = [number(projection, name) for name in ("k2", "k3", "k4", "k5")]
        focal = [number(projection, name) for name in ("mu", "mv", "u0", "v0")]
        return camera(size(values), focal, terms, FISHEYE)
    raise CameraError(
        f"model_type is {kind!r}: expected PINHOLE or KANNALA_BRANDT; calibrate again with one of"
        " these"
    )


def _group(values: Values, name: str) -> Values:
    group = values.get(name)
    if not isinstance(group, Mapping):
        raise CameraError(f"{name} is {group!r}: expected a map of numbers")
    return group
