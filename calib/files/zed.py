"""ZED factory calibration, SNxxxx.conf: a section for each eye and resolution."""

from __future__ import annotations

import re
from collections.abc import Mapping

from calib.camera import FISHEYE, RADTAN, PinholeCamera
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
    DISTO. The second is used if there is one, and never mixed with the first.
    """
    section, lens = values["section"], values["lens"]
    focal = [number(section, name) for name in ("fx", "fy", "cx", "cy")]
    size_px = _SIZES[values["size"]]
    if not lens:
        return camera(size_px, focal, *_lens("the section", section))
    _check_complete(values["lens_name"], lens)
    terms, model = _lens(values["lens_name"], lens)
    if not any(terms) and any(number(section, term) for term in _RATIONAL if term in section):
        raise CameraError(
            f"the terms of {values['lens_name']} are 0 and those of the section are not: expected"
            " one lens; remove the wrong terms from the file"
        )
    return camera(size_px, focal, terms, model)


def _check_complete(name: str, lens: Values) -> None:
    """Check that a distortion section holds all terms of one model."""
    if set(_RATIONAL).intersection(lens) == set(_FISHEYE):
        return
    rational = any(term in lens for term in ("k4", "k5", "k6"))
    missing = [term for term in (_RATIONAL if rational else _FIVE) if term not in lens]
    if missing:
        raise CameraError(
            f"{name} has no {', '.join(missing)}: expected k1 to k6, p1 and p2 (radial-tangential)"
            " or k1 to k4 (fisheye); download the factory file again or calibrate with a board"
        )


def _lens(name: str, values: Values) -> tuple[list[float], str]:
    """Return the distortion terms and their model.

    The files do not name the model. As in the manufacturer's calibration program, k3 and k4 without
    p1 and p2 are a fisheye lens, whose other terms are missing or 0. Missing terms except k1 and k2
    are 0.
    """
    prism = [term for term in _PRISM if term in values and number(values, term)]
    if prism:
        raise CameraError(f"{prism[0]} is {values[prism[0]]}: expected no thin prism")
    terms = {term: number(values, term) for term in ("k1", "k2")}
    terms |= {term: number({term: 0, **values}, term) for term in _RATIONAL[2:]}
    if not terms["k4"] or any(terms[term] for term in ("p1", "p2", "k5", "k6")):
        used = _RATIONAL if any(terms[term] for term in ("k4", "k5", "k6")) else _FIVE
        return [terms[term] for term in used], RADTAN
    if not terms["k3"]:
        raise CameraError(
            f"{name} has k4 {terms['k4']:g} without k3, p1, p2, k5 and k6, which does not tell a"
            " fisheye lens from a radial-tangential one: expected all terms of one of them;"
            " download the factory file again or calibrate with a board"
        )
    return [terms[term] for term in _FISHEYE], FISHEYE
