"""Camera files of other tools that are not read, and what to give instead."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

_OWN: Final = "write a file with width, height, fx, fy, cx, cy and distortion"
_CORNER: Final = (
    f"{_OWN}, cx and cy less 0.5, because they count from the corner of the first pixel"
)
_COLMAP = re.compile(
    r"^\d+\s+(SIMPLE_|FULL_)?(PINHOLE|RADIAL|OPENCV|FOV|THIN_PRISM)\w*\s+\d+\s+\d+\s", re.MULTILINE
)
_TEXTS = (
    (_COLMAP, f"cameras of COLMAP are not read: {_CORNER}"),
    (
        re.compile(r"^Camera-system parameters:|aslam_cv", re.MULTILINE),
        "the text report of Kalibr is not read: give the camchain file (YAML) beside it",
    ),
)
_BEGINNING = 20_000


def hint_of_text(text: str) -> str | None:
    """Return what to give instead of a text of another tool, or None for another text."""
    start = text[:_BEGINNING]
    return next((hint for pattern, hint in _TEXTS if pattern.search(start)), None)


def hint_of_values(values: Any) -> str | None:
    """Return what to give instead of the parsed file of another tool, or None for another file."""
    if not isinstance(values, Mapping):
        return None
    if "CalibrationInformation" in values:
        return (
            "the raw calibration of an Azure Kinect is not read, as it is for no picture mode:"
            f" {_OWN}, the values that k4a_device_get_calibration gives for the mode used"
        )
    if "fl_x" in values or "camera_angle_x" in values:
        return f"transforms of a radiance field (nerfstudio, instant-ngp) are not read: {_CORNER}"
    if "projection" in values and "f" in values:
        return (
            "a calibration of Metashape is not read: save it from Tools, Camera Calibration in the"
            " format OpenCV"
        )
    if any(isinstance(inner, Mapping) and "projection_type" in inner for inner in values.values()):
        return (
            "cameras of OpenSfM are not read, whose focal lengths are shares of the longer side:"
            f" {_OWN} in pixels"
        )
    return None
