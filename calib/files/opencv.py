"""OpenCV FileStorage of its calibration programs, YAML or XML, and files with its names.

One camera under names such as camera_matrix, or the cameras of a pair under names such as M1 and D1
(OpenCV's stereo_calib), K_LEFT and D_LEFT (ZED), or M and D alone (VOXL).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from calib.camera import PinholeCamera
from calib.distortion import FISHEYE, RADTAN
from calib.files.fields import Values, camera, flag, matrix, numbers, one_of, size, tell_choice
from calib.files.lens_names import lens_of

_MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix")
_TERMS = (
    "distortion_coefficients",
    "distCoeffs",
    "dist_coeffs",
    "Distortion_Coefficients",
    "distortion_coeffs",
    "dist_coeff",
    "dist",
)
_SIDE = r"(?P<before>left|right|l|r|)(?P<what>{})(?P<after>left|right|l|r|\d|)"
_SIDED_MATRIX = re.compile(_SIDE.format("m|k|mtx|cameramatrix|intrinsics?|intrinsicmatrix"))
_SIDED_TERMS = re.compile(_SIDE.format("d|dist|distcoeffs?|distortion(coefficients|coeffs)?"))
_FISHEYE_TERMS = 4
_WORDS = {"l": "left", "r": "right"}


def find(values: Values) -> dict[str, Values]:
    """Return the camera if there is a camera matrix under one of its usual names."""
    known = any(name in values for name in _MATRIX)
    return {str(values.get("camera_name", "")): values} if known else {}


def build(values: Values) -> PinholeCamera:
    """Create the camera; `fisheye_model` 1, or a `distortion_model`, names the model."""
    model, lens = _lens(values, numbers(values, one_of(values, *_TERMS)))
    return camera(size(values), matrix(values, one_of(values, *_MATRIX)), lens, model)


def _lens(values: Values, terms: Sequence[float]) -> tuple[str, Sequence[float]]:
    """Return the model that the file names, radial-tangential if it names none, and its terms."""
    _tell_if_unsure(values, terms)
    if flag(values, "fisheye_model"):
        return FISHEYE, terms
    return lens_of("distortion_model", values.get("distortion_model", RADTAN), terms)


def _tell_if_unsure(values: Values, terms: Sequence[float]) -> None:
    """Tell that four terms may be those of either model, if the file names none."""
    is_named = any(name in values for name in ("fisheye_model", "distortion_model"))
    if len(terms) == _FISHEYE_TERMS and any(terms) and not is_named:
        tell_choice(
            "its 4 terms are taken for k1 k2 p1 p2, as it names no model; of a fisheye lens it"
            " needs the line fisheye_model: 1"
        )


def find_sides(values: Values) -> dict[str, Values]:
    """Return the cameras by the names of their matrices, such as M1 and K_LEFT.

    They are also known as left and right. A camera alone has an empty name.
    """
    matrices = _by_side(values, _SIDED_MATRIX)
    terms = _by_side(values, _SIDED_TERMS)
    sides = {side: name for side, name in matrices.items() if side in terms}
    if set(sides) == {""}:
        return {"": {**values, "matrix": matrices[""], "terms": terms[""]}}
    first = "0" in sides
    words = {"0": "left", "1": "right"} if first else {"1": "left", "2": "right"}
    return {
        name: {
            **values,
            "matrix": name,
            "terms": terms[side],
            "aliases": (words.get(side, side), name.lower()),
        }
        for side, name in sides.items()
        if side
    }


def _by_side(values: Values, pattern: re.Pattern[str]) -> dict[str, str]:
    """Return the names of matrices by the side that the names tell."""
    found: dict[str, str] = {}
    for name, value in values.items():
        match = pattern.fullmatch(str(name).replace("_", "").lower())
        if match is None or not _is_matrix(value):
            continue
        side = match["before"] or match["after"]
        if not (match["before"] and match["after"]):
            found.setdefault(_WORDS.get(side, side), str(name))
    return found


def _is_matrix(value: Any) -> bool:
    return isinstance(value, list) or (isinstance(value, Mapping) and "data" in value)


def build_side(values: Values) -> PinholeCamera:
    """Create the camera of one side; a `distortion_model` is used if there is one."""
    model, lens = _lens(values, numbers(values, values["terms"]))
    return camera(size(values), matrix(values, values["matrix"]), lens, model)
