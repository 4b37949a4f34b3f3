"""ROS messages sensor_msgs/CameraInfo, as ``ros2 topic echo`` and ``rostopic echo`` print them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from calib.camera import PinholeCamera
from calib.distortion import RADTAN
from calib.errors import CameraError
from calib.files.fields import Values, camera, lens_model, matrix, number, numbers, one_of, size
from calib.files.ros_camera_info import MODELS

_CALIBRATION = ("width", "height", "distortion_model", "d", "D", "k", "K", "roi")


def by_frame(documents: Sequence[Any]) -> dict[str, Values]:
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


def find(values: Values) -> dict[str, Values]:
    """Return the message by its frame_id, or the messages in a map by their names."""
    if _is_message(values):
        return {_frame(values): values}
    return {str(name): message for name, message in values.items() if _is_message(message)}


def build(values: Values) -> PinholeCamera:
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
    model = RADTAN if undistorted else lens_model("distortion_model", name, MODELS)
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
