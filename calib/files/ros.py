"""ROS: camera_info files, printed CameraInfo messages, and parameter files.

- camera_info YAML, as camera_calibration and camera_calibration_parsers write it.
- Messages sensor_msgs/CameraInfo, as `ros2 topic echo` and `rostopic echo` print them.
- Parameter files: an image size and a map named after the model, with K and D.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from calib.camera import PinholeCamera
from calib.distortion import FISHEYE, RADTAN
from calib.errors import CameraError
from calib.files.fields import Values, camera, lens_model, matrix, number, numbers, one_of, size

_MODELS = {"plumb_bob": RADTAN, "rational_polynomial": RADTAN, "equidistant": FISHEYE}
_LENSES = {"fisheye": FISHEYE, "equidistant": FISHEYE, "radtan": RADTAN, "plumb_bob": RADTAN}
_CALIBRATION = ("width", "height", "distortion_model", "d", "D", "k", "K", "roi")


def find_camera_info(values: Values) -> dict[str, Values]:
    """Return the camera if a camera matrix comes with ROS's model name or projection matrix."""
    ros = "distortion_model" in values or "projection_matrix" in values
    return {str(values.get("camera_name", "")): values} if ros and "camera_matrix" in values else {}


def build_camera_info(values: Values) -> PinholeCamera:
    """Create the camera of the raw image; as in ROS, the default model is plumb_bob."""
    name = values.get("distortion_model", "plumb_bob")
    return camera(
        size(values),
        matrix(values, "camera_matrix"),
        numbers(values, one_of(values, "distortion_coefficients", "distortion_coeffs")),
        lens_model("distortion_model", name, _MODELS),
    )


def messages_by_frame(documents: Sequence[Any]) -> dict[str, Values]:
    """Return the messages of a dump by their frame_id; empty if a document is no message.

    Messages of the same calibration count once. Others of the same frame_id are numbered.
    """
    if not all(_is_message(document) for document in documents):
        return {}
    found: dict[str, Values] = {}
    different: dict[tuple[str, str], Values] = {}
    for message in documents:
        calibration = repr([message.get(name) for name in _CALIBRATION])
        different.setdefault((_frame(message), calibration), message)
    count: Counter[str] = Counter()
    for (frame, _), message in different.items():
        count[frame] += 1
        found[frame if count[frame] == 1 else f"{frame} {count[frame]}".strip()] = message
    return found


def find_messages(values: Values) -> dict[str, Values]:
    """Return the message by its frame_id, or the messages in a map by their names."""
    if _is_message(values):
        return {_frame(values): values}
    return {str(name): message for name, message in values.items() if _is_message(message)}


def build_message(values: Values) -> PinholeCamera:
    """Create the camera of the raw image from K and D.

    An empty model without terms is an undistorted image.
    """
    _check_region(values)
    name = values["distortion_model"]
    matrix_name = one_of(values, "k", "K")
    terms = numbers(values, one_of(values, "d", "D"))
    if not any(numbers(values, matrix_name)):
        raise CameraError(
            f"{matrix_name} is all 0, ROS's mark of an uncalibrated camera: expected a calibration"
        )
    undistorted = name == "" and not any(terms)
    model = RADTAN if undistorted else lens_model("distortion_model", name, _MODELS)
    return camera(size(values), matrix(values, matrix_name), terms, model)


def _is_message(values: Any) -> bool:
    return (
        isinstance(values, Mapping)
        and "distortion_model" in values
        and ("k" in values or "K" in values)
    )


def _frame(message: Values) -> str:
    header = message.get("header")
    frame = header.get("frame_id") if isinstance(header, Mapping) else None
    return str(frame or "")


def _check_region(values: Values) -> None:
    """Check that the images are whole images, which K is for."""
    region = values.get("roi")
    if not isinstance(region, Mapping):
        return
    width, height = (number({side: 0, **region}, side) for side in ("width", "height"))
    if (width, height) not in ((0, 0), size(values)):
        raise CameraError(
            f"roi is {width:g}x{height:g} px: expected the whole image; record the camera without a"
            " region of interest"
        )


def find_parameters(values: Values) -> dict[str, Values]:
    """Return every map, at any depth, that has an image size and a lens."""
    found: dict[str, Values] = {}
    for name, inner in values.items():
        if isinstance(inner, Mapping):
            is_camera = "image_width" in inner and _lenses(inner)
            found.update({str(name): inner} if is_camera else find_parameters(inner))
    return found


def _lenses(values: Values) -> list[str]:
    """Return the names of the maps with K and D."""
    return [
        name
        for name, lens in values.items()
        if isinstance(lens, Mapping) and "K" in lens and "D" in lens
    ]


def build_parameters(values: Values) -> PinholeCamera:
    """Create the camera for the image size in the file; use `scaled` for other sizes."""
    lenses = _lenses(values)
    if len(lenses) > 1:
        raise CameraError(f"{' and '.join(lenses)} both hold K and D: expected one lens")
    lens = values[lenses[0]]
    model = lens_model("the lens", lenses[0], _LENSES)
    return camera(size(values), matrix(lens, "K"), numbers(lens, "D"), model)
