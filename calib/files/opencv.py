"""OpenCV FileStorage of its calibration programs, YAML or XML."""

from __future__ import annotations

from calib.camera import PinholeCamera
from calib.distortion import FISHEYE, RADTAN
from calib.files.fields import Values, camera, flag, matrix, numbers, one_of, size

_MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix")
_TERMS = (
    "distortion_coefficients",
    "distCoeffs",
    "dist_coeffs",
    "Distortion_Coefficients",
)


def find(values: Values) -> dict[str, Values]:
    """Return the camera if there is a camera matrix under one of its usual names."""
    known = any(name in values for name in _MATRIX)
    return {str(values.get("camera_name", "")): values} if known else {}


def build(values: Values) -> PinholeCamera:
    """Create the camera; `fisheye_model` 1 means the fisheye model."""
    model = FISHEYE if flag(values, "fisheye_model") else RADTAN
    return camera(
        size(values),
        matrix(values, one_of(values, *_MATRIX)),
        numbers(values, one_of(values, *_TERMS)),
        model,
    )
