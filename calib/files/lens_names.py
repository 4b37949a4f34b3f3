"""The names that drivers and tools give to lens models."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from calib.distortion import FISHEYE, RADTAN
from calib.errors import CameraError

_NONE = ("", "none", "no distortion", "rectified", "undistorted")
_RADTAN = (
    *("plumb bob", "plumbbob", "radtan", "radial tangential", "radialtangential"),
    *("rational polynomial", "rational", "brown conrady", "thin prism", "opencv"),
)
_FISHEYE = (
    *("equidistant", "equi", "fisheye", "opencv fisheye", "fisheye equidistant"),
    *("kannala brandt", "kannala brandt4", "kannalabrandt", "kannala brandt8", "kannalabrandt8"),
    *("kb", "kb4", "kb8"),
)
_MODELS = (
    dict.fromkeys(_NONE, "") | dict.fromkeys(_RADTAN, RADTAN) | dict.fromkeys(_FISHEYE, FISHEYE)
)
_OTHER_FORMULAS = ("inverse brown conrady", "modified brown conrady", "ftheta", "f theta")
# Words of lenses of other formulas that bend light with terms of 0 too.
_WIDE = re.compile(r"fish|kannala|equidist|equirect|spher|cylind|omni|\bmei\b|\btheta\b")
_PREFIX = re.compile(r"^(rs2[ ._])?distortion[ ._]|^sensor[ ._]")
_FISHEYE_TERMS = 4


def lens_of(field: str, name: Any, terms: Sequence[float]) -> tuple[str, tuple[float, ...]]:
    """Return the distortion model and its terms for a tool's name of the model.

    Terms of 0 are no distortion, whatever the name. Only fisheye lenses and other wide ones bend
    light with terms of 0 too.

    Args:
        field: The field with the name, for messages.
        name: Its value; None and an empty text stand for no model.
        terms: The terms in the file's order, which is OpenCV's.

    Raises:
        CameraError: If the name is unknown, or that of a model with other formulas, and terms are
            not 0; or the name is that of a wide lens that is not known.
    """
    plain = _plain(name)
    model = None if plain is None else _MODELS.get(plain)
    if model == FISHEYE:
        extra = terms[_FISHEYE_TERMS:]
        return FISHEYE, tuple(terms if any(extra) else terms[:_FISHEYE_TERMS])
    is_wide = plain is not None and plain not in _OTHER_FORMULAS and _WIDE.search(plain)
    if isinstance(name, str | None) and not any(terms) and not is_wide:
        return RADTAN, ()
    if plain in _OTHER_FORMULAS:
        raise CameraError(
            f"{field} is {name!r} with terms {list(terms)}: expected Brown Conrady (plumb_bob),"
            " because the terms of this model have another meaning; calibrate the camera with a"
            " board"
        )
    if plain in _NONE[1:]:
        raise CameraError(f"{field} is {name!r} with terms {list(terms)}: expected terms of 0")
    if not model:
        raise CameraError(
            f"{field} is {name!r}: expected plumb_bob, rational_polynomial or equidistant, or"
            " another name of these, such as radtan, Brown Conrady and fisheye"
        )
    return model, tuple(terms)


def _plain(name: Any) -> str | None:
    """Return a name in lower case with single spaces, without a prefix; None if it is no text."""
    if name is None:
        return ""
    if not isinstance(name, str):
        return None
    return re.sub(r"[\s_-]+", " ", _PREFIX.sub("", name.strip().lower())).strip()
