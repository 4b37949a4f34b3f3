"""ROS camera_info YAML, as written by camera_calibration and camera_calibration_parsers."""

from __future__ import annotations

from calib.camera import PinholeCamera
from calib.distortion import FISHEYE, RADTAN
from calib.files.fields import Values, camera, lens_model, matrix, numbers, one_of, size

MODELS = {"plumb_bob": RADTAN, "rational_polynomial": RADTAN, "equidistant": FISHEYE}


def find(values: Values) -> dict[str, Values]:
    """Return the camera if a camera matrix comes with ROS's model name or projection matrix."""
    ros = "distortion_model" in values or "projection_matrix" in values
    return {str(values.get("camera_name", "")): values} if ros and "camera_matrix" in values else {}


def build(values: Values) -> PinholeCamera:
    """Create the camera of the raw image; as in ROS, the default model is plumb_bob."""
    name = values.get("distortion_model", "plumb_bob")
    return camera(
        size(values),
        matrix(values, "camera_matrix"),
        numbers(values, one_of(values, "distortion_coefficients", "distortion_coeffs")),
        lens_model("distortion_model", name, MODELS),
    )
