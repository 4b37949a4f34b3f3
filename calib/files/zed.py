"""ZED factory calibration, SNxxxx.conf: a section for each eye and resolution."""

from __future__ import annotations

import re
from collections.abc import Mapping

from calib.camera import PinholeCamera
from calib.distortion import FISHEYE, RADTAN
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
_SECTION = re.compile(r"(?P<eye>LEFT_|RIGHT_|)CAM_(?P<size>\w+)")
_FIVE = ("k1", "k2", "p1", "p2", "k3")
_RATIONAL = (*_FIVE, "k4", "k5", "k6")
_FISHEYE = ("k1", "k2", "k3", "k4")
_PRISM = ("s1", "s2", "s3", "s4")
_REMEDY = "download the factory file again or calibrate with a board"


def find(values: Values) -> dict[str, Values]:
    """Return every eye at every known resolution, with the distortion section of the eye."""
    found: dict[str, Values] = {}
    for name, section in values.items():
        match = _SECTION.fullmatch(str(name))
        if match and match["size"].upper() in _SIZES and isinstance(section, Mapping):
            lens_name = f"{match['eye']}DISTO"
            lens = values.get(lens_name)
            found[name] = {
                "section": section,
                "size": match["size"].upper(),
                "lens_name": lens_name,
                "lens": lens if isinstance(lens, Mapping) else {},
            }
    return found


def build(values: Values) -> PinholeCamera:
    """Create the camera; the section's name gives the image size.

    Newer files hold two models of the same lens: five terms in each section of a resolution, for
    older programs, and the model of the manufacturer's own software in LEFT_DISTO, RIGHT_DISTO or
    DISTO. The second is used if there is one, and never mixed with the first. Sections without one
    may leave out terms that are 0, except k1 and k2.
    """
    section = values["section"]
    lens = values["lens"] or section
    name = "the section" if lens is section else values["lens_name"]
    used, model = _model(name, lens)
    required = used[:2] if lens is section else used
    missing = [term for term in required if term not in lens]
    if missing:
        raise CameraError(
            f"{name} has no {', '.join(missing)}: expected k1 to k6, p1 and p2 (radial-tangential)"
            f" or k1 to k4 (fisheye); {_REMEDY}"
        )
    terms = [_term(lens, term) for term in used]
    if not any(terms) and any(_term(section, term) for term in _RATIONAL):
        raise CameraError(
            f"the terms of {name} are 0 and those of the section are not: expected one lens; remove"
            " the wrong terms from the file"
        )
    focal = [number(section, field) for field in ("fx", "fy", "cx", "cy")]
    return camera(_SIZES[values["size"]], focal, terms, model)


def _model(name: str, values: Values) -> tuple[tuple[str, ...], str]:
    """Return the names of the terms that are used, and the model.

    The files do not name the model. As in the manufacturer's calibration program, k3 and k4 without
    p1 and p2 are a fisheye lens, whose other terms are missing or 0.
    """
    prism = [term for term in _PRISM if _term(values, term)]
    if prism:
        raise CameraError(f"{prism[0]} is {values[prism[0]]}: expected no thin prism")
    k4 = _term(values, "k4")
    if not k4 or any(_term(values, term) for term in ("p1", "p2", "k5", "k6")):
        rational = any(_term(values, term) for term in ("k4", "k5", "k6"))
        return (_RATIONAL if rational else _FIVE), RADTAN
    if not _term(values, "k3"):
        raise CameraError(
            f"{name} has k4 {k4:g} without k3, p1, p2, k5 and k6, which is neither a whole fisheye"
            f" lens nor a whole radial-tangential one: expected all terms of one; {_REMEDY}"
        )
    return _FISHEYE, FISHEYE


def _term(values: Values, name: str) -> float:
    return number({name: 0, **values}, name)
