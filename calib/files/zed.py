"""ZED factory calibration, SNxxxx.conf: a section for each eye and resolution."""

from __future__ import annotations

import re
from collections.abc import Mapping

from calib.camera import FISHEYE, PinholeCamera
from calib.errors import CameraError
from calib.files.fields import Values, camera, number

_SIZES = {
    "2K": (2208, 1242),
    "FHD": (1920, 1080),
    "HD": (1280, 720),
    "VGA": (672, 376),
    "FHD1200": (1920, 1200),
    "SVGA": (960, 600),
    "QHDPLUS": (3200, 1800),
    "4K": (3840, 2160),
}
_SECTION = re.compile(r"(?P<eye>LEFT|RIGHT)_CAM_(?P<size>\w+)")


def find(values: Values) -> dict[str, Values]:
    """Return every eye at every known resolution, with the distortion of newer files merged in."""
    found: dict[str, Values] = {}
    for name, section in values.items():
        match = _SECTION.fullmatch(str(name))
        if match and match["size"].upper() in _SIZES and isinstance(section, Mapping):
            lens = values.get(f"{match['eye']}_DISTO", {})
            found[name] = {**lens, **section, "section": match["size"].upper()}
    return found


def build(values: Values) -> PinholeCamera:
    """Create the camera; the section's name gives the image size.

    A lens with k1 to k4 alone is a fisheye. Missing fields are 0, except k1 and k2, which are
    required.
    """
    prism = [name for name in ("s1", "s2", "s3", "s4") if number({name: 0, **values}, name)]
    if prism:
        raise CameraError(f"{prism[0]} is {values[prism[0]]}: expected no thin prism")
    focal = [number(values, name) for name in ("fx", "fy", "cx", "cy")]
    size_px = _SIZES[values["section"]]
    if "k4" in values and not any(name in values for name in ("p1", "p2", "k5", "k6")):
        terms = [number(values, name) for name in ("k1", "k2", "k3", "k4")]
        return camera(size_px, focal, terms, FISHEYE)
    rest = ("p1", "p2", "k3", "k4", "k5", "k6")
    terms = [number(values, "k1"), number(values, "k2")]
    terms += [number({name: 0, **values}, name) for name in rest]
    return camera(size_px, focal, terms if any(terms[5:]) else terms[:5])
