"""ROS's second format of camera_info, ost.txt: headings, names and numbers."""

from __future__ import annotations

import re
from typing import Any

from calib.camera import PinholeCamera
from calib.errors import CameraError
from calib.files import ros
from calib.files.fields import Values, numbers

_START = re.compile(r"^\s*\[image\]\s*\n\s*(width|height)\s*\n", re.MULTILINE)
_FIELDS = {
    "camera matrix": "camera_matrix",
    "distortion": "distortion_coefficients",
    "projection": "projection_matrix",
}
_FISHEYE_TERMS = 4


def parse_text(text: str) -> dict[str, Values]:
    """Return the cameras of a text by their headings; empty for another text."""
    if not _START.search(text):
        return {}
    fields: dict[str, dict[str, list[float]]] = {}
    heading = name = ""
    for line in text.splitlines():
        content = line.split("#")[0].split(";")[0].strip()
        if content.startswith("[") and content.endswith("]"):
            heading, name = content[1:-1].strip(), ""
        elif content:
            found = _numbers(content)
            if found is None:
                name = content.lower()
                fields.setdefault(heading, {}).setdefault(name, [])
            else:
                fields.setdefault(heading, {}).setdefault(name, []).extend(found)
    image = fields.get("image", {})
    size: dict[str, Any] = {
        f"image_{side}": image[side][0] for side in ("width", "height") if image.get(side)
    }
    return {
        heading: {
            **size,
            **{_FIELDS[name]: values for name, values in own.items() if name in _FIELDS},
            "is_ini": True,
            "aliases": (heading.rpartition("/")[2],),
        }
        for heading, own in fields.items()
        if "camera matrix" in own
    }


def _numbers(line: str) -> list[float] | None:
    try:
        return [float(word) for word in line.split()]
    except ValueError:
        return None


def find(values: Values) -> dict[str, Values]:
    """Return the cameras of `parse_text`."""
    return {
        name: inner
        for name, inner in values.items()
        if isinstance(inner, dict) and inner.get("is_ini") is True
    }


def build(values: Values) -> PinholeCamera:
    """Create the camera of the raw image.

    The format does not name the model. camera_calibration writes five or more terms of its usual
    lenses, and four of fisheye lenses.
    """
    for word, name in _FIELDS.items():
        if values.get(name) == []:
            raise CameraError(f"there are no numbers below {word!r}: expected some")
    terms = numbers(values, "distortion_coefficients")
    if len(terms) == _FISHEYE_TERMS and any(terms):
        raise CameraError(
            "distortion has 4 numbers, which may be those of a fisheye lens: expected 5 or more;"
            " give the ost.yaml beside it, which names the model"
        )
    return ros.build_camera_info(values)
