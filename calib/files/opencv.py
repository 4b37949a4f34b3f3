"""OpenCV's FileStorage as its calibration programs write it, YAML or XML."""

from __future__ import annotations

from calib.camera import FISHEYE, RADTAN, PinholeCamera
from calib.files.fields import Values, camera, flag, matrix, numbers, one_of, size

_MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix")
_TERMS = (
    "distortion_coefficients",
    "distCoeffs",
    "dist_coeffs",
    "Distortion_Coefficients",
)


def find(values: Values) -> dict[str, Values]:
    """A camera matrix at the top, under one of the names in use."""
    known = any(name in values for name in _MATRIX)
    return {str(values.get("camera_name", "")): values} if known else {}


def build(values: Values) -> PinholeCamera:
    """The order of the terms is OpenCV's own; ``fisheye_model`` 1 means its fisheye module."""
    model = FISHEYE if flag(values, "fisheye_model") else RADTAN
    return camera(
        size(values),
        matrix(values, one_of(values, *_MATRIX)),
        numbers(values, one_of(values, *_TERMS)),
        model,
    )
