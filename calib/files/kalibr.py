"""Kalibr camchain YAML: cam0, cam1, ... with intrinsics, model and resolution."""

from __future__ import annotations

from collections.abc import Mapping

from calib.camera import PinholeCamera
from calib.distortion import FISHEYE, RADTAN
from calib.errors import CameraError
from calib.files.fields import Values, camera, lens_model, numbers, one_of, size

_MODELS = {"radtan": RADTAN, "equidistant": FISHEYE, "none": RADTAN}
_TERMS = 4


def find(values: Values) -> dict[str, Values]:
    """Return every top-level map that has a list of intrinsics."""
    return {
        str(name): camera_values
        for name, camera_values in values.items()
        if isinstance(camera_values, Mapping)
        and not isinstance(camera_values.get("intrinsics", {}), Mapping)
    }


def build(values: Values) -> PinholeCamera:
    """Create the camera; intrinsics are fu, fv, pu, pv, distortions OpenCV's first four terms."""
    kind = values.get("camera_model")
    if kind != "pinhole":
        raise CameraError(
            f"camera_model is {kind!r}: expected pinhole; calibrate again with the model"
            " pinhole-radtan or, for fisheye lenses, pinhole-equi"
        )
    intrinsics = numbers(values, "intrinsics")
    if len(intrinsics) != 4:
        raise CameraError(f"intrinsics has {len(intrinsics)} numbers: expected fu, fv, pu, pv")
    name = values.get("distortion_model")
    model = lens_model("distortion_model", name, _MODELS)
    terms = numbers(values, one_of(values, "distortion_coeffs", "distortion_coefficients"))
    expected = 0 if name == "none" else _TERMS
    if len(terms) != expected:
        raise CameraError(f"distortion_coeffs has {len(terms)} terms: expected {expected}")
    return camera(size(values), intrinsics, terms, model)
