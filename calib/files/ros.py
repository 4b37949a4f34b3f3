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
from calib.errors import CameraError
from calib.files.fields import (
    Values,
    camera,
    matrix,
    number,
    numbers,
    one_of,
    size,
    tell_choice,
)
from calib.files.lens_names import lens_of

_CALIBRATION = (
    *("width", "height", "distortion_model", "d", "D", "k", "K"),
    *("roi", "binning_x", "binning_y"),
)
_PROJECTION = ("p", "P", "projection_matrix")
_MOST_PX = 100_000


def find_camera_info(values: Values) -> dict[str, Values]:
    """Return the camera if a camera matrix comes with ROS's model name or projection matrix."""
    ros = "distortion_model" in values or "projection_matrix" in values
    return {str(values.get("camera_name", "")): values} if ros and "camera_matrix" in values else {}


def build_camera_info(values: Values) -> PinholeCamera:
    """Create the camera of the raw image; as in ROS, the default model is plumb_bob.

    A camera matrix of 0 beside a projection matrix stands for rectified images.
    """
    if (focal_px := _rectified(values, "camera_matrix")) is not None:
        return camera(size(values), focal_px, ())
    terms = numbers(values, one_of(values, "distortion_coefficients", "distortion_coeffs"))
    model, lens = lens_of("distortion_model", values.get("distortion_model", "plumb_bob"), terms)
    return camera(size(values), matrix(values, "camera_matrix"), lens, model)


def messages_by_frame(documents: Sequence[Any]) -> dict[str, Values]:
    """Return the messages of a dump by their frame_id; empty if a document is no message.

    Messages of the same calibration count once. Others of the same frame_id are numbered.
    """
    if not all(_is_message(document) for document in documents):
        return {}
    found: dict[str, Values] = {}
    different: dict[tuple[str, str], Values] = {}
    for message in documents:
        calibration = repr([message.get(name) for name in _calibration(message)])
        different.setdefault((_frame(message), calibration), message)
    count: Counter[str] = Counter()
    for (frame, _), message in different.items():
        count[frame] += 1
        found[frame if count[frame] == 1 else f"{frame} {count[frame]}".strip()] = message
    return found


def _calibration(message: Values) -> tuple[str, ...]:
    """Return the fields that make the camera of a message."""
    raw = any(_is_given(message, name) for name in ("k", "K"))
    return _CALIBRATION if raw else (*_CALIBRATION, *_PROJECTION)


def find_messages(values: Values) -> dict[str, Values]:
    """Return the message by its frame_id, or the messages in a map by their names."""
    if _is_message(values):
        return {_frame(values): values}
    return {str(name): message for name, message in values.items() if _is_message(message)}


def build_message(values: Values) -> PinholeCamera:
    """Create the camera of a message's images from K and D.

    K of 0 beside P stands for rectified images, whose camera P is. K and P are for the whole image
    before binning; the camera is that of the region of interest, with binned pixels.

    Args:
        values: The fields width, height, distortion_model, d or D, k or K; if given p or P, roi
            (x_offset, y_offset, width, height), binning_x and binning_y.

    Raises:
        CameraError: If a value is invalid or the camera is not calibrated.
    """
    matrix_name = next((name for name in ("k", "K") if name in values), "k")
    if "k" in values and "K" in values:
        one_of(values, "k", "K")
    if (focal_px := _rectified(values, matrix_name)) is not None:
        return _windowed(values, camera(size(values), focal_px, ()))
    terms = numbers(values, one_of(values, "d", "D"))
    if not any(numbers(values, matrix_name)):
        raise CameraError(
            f"{matrix_name} is all 0, ROS's mark of an uncalibrated camera: expected a calibration"
        )
    model, lens = lens_of("distortion_model", values["distortion_model"], terms)
    whole = camera(size(values), matrix(values, matrix_name), lens, model)
    return _windowed(values, whole)


def _rectified(values: Values, matrix_name: str) -> tuple[float, ...] | None:
    """Return fx, fy, cx, cy of the projection matrix if it is the only one that is given."""
    name = next((name for name in _PROJECTION if _is_given(values, name)), None)
    if name is None or _is_given(values, matrix_name):
        return None
    projection = numbers(values, name)
    if len(projection) != 12:
        raise CameraError(f"{name} has {len(projection)} numbers: expected 3x4")
    fx, skew, cx, _, below, fy, cy, *_ = projection
    tell_choice(f"{matrix_name} is all 0: taken for rectified pictures, with {name} alone")
    return matrix({name: [fx, skew, cx, below, fy, cy, *projection[8:11]]}, name)


def _is_given(values: Values, name: str) -> bool:
    """Whether a field is there and is no matrix of 0."""
    found = values.get(name)
    data = found.get("data") if isinstance(found, Mapping) else found
    return name in values and (any(data) if isinstance(data, list | tuple) else True)


def _is_message(values: Any) -> bool:
    return (
        isinstance(values, Mapping)
        and "distortion_model" in values
        and any(name in values for name in ("k", "K", "p", "P"))
    )


def _frame(message: Values) -> str:
    header = message.get("header")
    frame = header.get("frame_id") if isinstance(header, Mapping) else None
    return str(frame or "")


def _windowed(values: Values, whole: PinholeCamera) -> PinholeCamera:
    """Return the camera of the part of the image that a message's pictures show, binned."""
    region = values.get("roi")
    region = region if isinstance(region, Mapping) else {}
    x_px, y_px, width, height = (
        _whole(region, name) for name in ("x_offset", "y_offset", "width", "height")
    )
    columns, rows = (_whole(values, name) or 1 for name in ("binning_x", "binning_y"))
    found = whole
    if any((x_px, y_px, width, height)) and (width, height) != (whole.width, whole.height):
        tell_choice(
            f"roi is {width}x{height} px at ({x_px}, {y_px}): the camera is taken for pictures of"
            " this region"
        )
        found = found.cropped(x_px, y_px, width, height)
    return found if (columns, rows) == (1, 1) else found.binned(columns, rows)


def _whole(values: Values, name: str) -> int:
    """Return a count of pixels; 0 if it is missing."""
    found = number({name: 0, **values}, name)
    if not 0 <= found <= _MOST_PX or found != int(found):
        raise CameraError(f"{name} is {found:g}: expected 0 to {_MOST_PX} whole pixels")
    return int(found)


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
    model, terms = lens_of("the lens", lenses[0], numbers(lens, "D"))
    return camera(size(values), matrix(lens, "K"), terms, model)
