"""camera_info YAML of ROS, as camera_calibration writes and camera_calibration_parsers reads it."""

from __future__ import annotations

from calib.camera import FISHEYE, RADTAN, PinholeCamera
from calib.files.fields import Values, camera, lens_model, matrix, numbers, one_of, size

_MODELS = {"plumb_bob": RADTAN, "rational_polynomial": RADTAN, "equidistant": FISHEYE}


def find(values: Values) -> dict[str, Values]:
    """A camera matrix with ROS's model name or projection beside it."""
    ros = "distortion_model" in values or "projection_matrix" in values
    return {str(values.get("camera_name", "")): values} if ros and "camera_matrix" in values else {}


def build(values: Values) -> PinholeCamera:
    """The raw image's camera; a missing model name means plumb_bob, as for ROS itself."""
    name = values.get("distortion_model", "plumb_bob")
    return camera(
        size(values),
        matrix(values, "camera_matrix"),
        numbers(values, one_of(values, "distortion_coefficients", "distortion_coeffs")),
        lens_model("distortion_model", name, _MODELS),
    )
