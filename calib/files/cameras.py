"""Read a camera from any known file format; write the project's own."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from basetree.errors import InputFileError, short_line
from basetree.files.json import json_text
from basetree.files.limits import current_limits
from basetree.files.reading import read_text
from basetree.files.writing import write_text
from calib.camera import PinholeCamera
from calib.errors import CameraError
from calib.files import (
    camodocal,
    depthai,
    kalibr,
    matrices,
    opencv,
    orb_slam,
    own,
    realsense,
    ros,
    ros_ini,
    zed,
)
from calib.files.fields import Values, choices_of
from calib.files.not_read import hint_of_text, hint_of_values
from calib.files.text import parse

_log = logging.getLogger(__name__)
_EXPECTED = "a camera file"
_TEXTS = (realsense.parse_text, ros_ini.parse_text, matrices.parse_text)  # of no general format


class _Format(NamedTuple):
    """A camera file format.

    Attributes:
        title: Name for messages.
        find: Returns the cameras in a file's values by name; empty for another format.
        build: Creates a PinholeCamera from one camera's values.
    """

    title: str
    find: Callable[[Values], dict[str, Values]]
    build: Callable[[Values], PinholeCamera]


# In order of trial: the first that finds a camera reads the file, so general formats come last.
_FORMATS = (
    _Format(own.SCHEMA, own.find, own.build),
    _Format("ROS camera_info", ros.find_camera_info, ros.build_camera_info),
    _Format("ROS camera_info (ost.txt)", ros_ini.find, ros_ini.build),
    _Format("OpenCV", opencv.find, opencv.build),
    _Format("ROS CameraInfo messages", ros.find_messages, ros.build_message),
    _Format("Kalibr camchain", kalibr.find, kalibr.build),
    _Format("CamOdoCal", camodocal.find, camodocal.build),
    _Format("ORB-SLAM settings", orb_slam.find, orb_slam.build),
    _Format("RealSense", realsense.find, realsense.build),
    _Format("ZED", zed.find, zed.build),
    _Format("DepthAI", depthai.find, depthai.build),
    _Format("Record3D", matrices.find_record3d, matrices.build_record3d),
    _Format("a 3x3 matrix", matrices.find, matrices.build),
    _Format("OpenCV's stereo_calib", opencv.find_sides, opencv.build_side),
    _Format("ROS parameters", ros.find_parameters, ros.build_parameters),
    _Format("fx, fy, cx and cy alone", own.find_plain, own.build_plain),
)


def load_camera(path: Path | str, *, name: str | None = None) -> PinholeCamera:
    """Read a camera file; the format is recognised by the content.

    Supported: the project's own JSON, also without its schema; ROS camera_info, CameraInfo messages
    as `ros2 topic echo` prints them, ost.txt and parameter files; OpenCV FileStorage (YAML, XML),
    of one camera or a pair; Kalibr
    camchains; CamOdoCal; ORB-SLAM settings; RealSense (text, JSON); ZED factory calibration;
    DepthAI; Record3D; a 3x3 matrix as text. Values that lenses seldom have are logged as warnings.

    Args:
        path: The file.
        name: Which camera of a file with several.

    Raises:
        InputFileError: If the file is missing, unreadable, of no known format or larger than
            `Limits` allows, or if `name` does not select one camera.
        CameraError: If a value is invalid; the message names the file.
    """
    path = Path(path)
    text = read_text(path, _EXPECTED)
    if (hint := hint_of_text(text)) is not None:
        raise InputFileError(f"{path}: {hint}")
    values: Any = next(filter(None, (parse_text(text) for parse_text in _TEXTS)), None)
    if values is None:
        values = parse(path, text, _EXPECTED)
    if isinstance(values, list):
        values = ros.messages_by_frame(values)
    for form in _FORMATS:
        if isinstance(values, Mapping) and (cameras := form.find(values)):
            chosen = _choose(path, cameras, name)
            try:
                with choices_of(_of_camera(path, chosen)):
                    camera = form.build(cameras[chosen])
            except CameraError as error:
                raise CameraError(f"{_of_camera(path, chosen)}: {error}") from error
            check_pixels(_of_camera(path, chosen), camera)
            for line in camera.unusual_values():
                _log.warning("%s: %s", short_line(_of_camera(path, chosen)), line)
            return camera
    if (hint := hint_of_values(values)) is not None:
        raise InputFileError(f"{path}: {hint}")
    known = ", ".join(form.title for form in _FORMATS)
    raise InputFileError(f"{path}: no known camera format, expected one of {known}")


def check_pixels(place: str, camera: PinholeCamera) -> None:
    """Check that pictures of this camera could be read."""
    largest = current_limits().image_pixels
    if camera.width * camera.height > largest:
        raise CameraError(
            f"{place}: the image size is {camera.width}x{camera.height}: expected at most {largest}"
            " pixels, the limit image_pixels"
        )


def _of_camera(path: Path, name: str) -> str:
    """Return the file and the name of its camera, for messages."""
    return f"{path} ({name})" if name else str(path)


def _choose(path: Path, cameras: Mapping[str, Values], name: str | None) -> str:
    """Return the name of the selected camera, which may be given by another name of it."""
    for known, values in cameras.items():
        if name is not None and name not in cameras and name in values.get("aliases", ()):
            return known
    names = ", ".join(repr(known) for known in cameras)
    if name is None and len(cameras) > 1:
        raise InputFileError(
            f"{path}: holds {len(cameras)} cameras, expected one of the names {names}"
        )
    if name is not None and set(cameras) == {""}:
        raise InputFileError(
            f"{path}: has no camera {name!r}, expected no name for its only camera"
        )
    if name is not None and name not in cameras:
        raise InputFileError(f"{path}: has no camera {name!r}, expected one of {names}")
    return next(iter(cameras)) if name is None else name


def save_camera(path: Path | str, camera: PinholeCamera) -> None:
    """Write a camera as JSON.

    Raises:
        InputFileError: If the file cannot be written.
    """
    write_text(Path(path), json_text(own.SCHEMA, camera.to_dict()))
