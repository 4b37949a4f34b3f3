"""Extract typed values from the nested values of a camera file.

Invalid values raise CameraError with a message that names the field. What was read in one of
several possible ways is logged as a warning.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from basetree.errors import short_line
from calib.camera import PinholeCamera
from calib.distortion import RADTAN
from calib.errors import CameraError
from calib.sizeless import sizeless_camera

Values = Mapping[str, Any]

_log = logging.getLogger(__name__)
_SIZES = (
    ("image_width", "image_height"),
    ("image_Width", "image_Height"),  # OpenCV 2
    ("width", "height"),
    ("imageWidth", "imageHeight"),
)
_SIZE_LISTS = ("resolution", "Size", "image_size", "imageSize", "img_size")
_GROUPS = (8, 12)  # of OpenCV's terms: rational lenses, thin prisms; then tilted sensors
_MOST_SKEW_PX = 0.1  # a point of the image moves by less than this


_place: ContextVar[str] = ContextVar("place", default="")


@contextmanager
def choices_of(place: str) -> Iterator[None]:
    """Name the file whose values are read, for the warnings of `tell_choice`."""
    token = _place.set(f"{place}: ")
    try:
        yield
    finally:
        _place.reset(token)


def tell_choice(line: str) -> None:
    """Log which of several possible ways of reading the values was taken."""
    _log.warning("%s", short_line(_place.get() + line))


def one_of(values: Values, *names: str) -> str:
    """Return which of several alternative names is present."""
    found = [name for name in names if name in values]
    if len(found) > 1:
        raise CameraError(f"{' and '.join(found)} are both given: expected one of them")
    if not found:
        raise CameraError(f"{' or '.join(names)} is missing: expected one of them")
    return found[0]


def number(values: Values, name: str) -> float:
    """Return a number; a string that spells one is accepted (INI, XML and YAML's 1e-5)."""
    if name not in values:
        raise CameraError(f"{name} is missing: expected a number")
    return _number(name, values[name])


def _number(name: str, value: Any) -> float:
    if not isinstance(value, bool) and isinstance(value, int | float | str):
        try:
            return float(value)
        except (ValueError, OverflowError):
            pass
    raise CameraError(f"{name} is {value!r}: expected a number")


def numbers(values: Values, name: str) -> tuple[float, ...]:
    """Return a list of numbers.

    Accepted: a flat list, a list of rows, a string, or the data of a matrix with rows and cols.
    """
    found = values.get(name)
    if isinstance(found, Mapping):
        data = numbers({name: found.get("data")}, name)
        if "rows" in found and "cols" in found:
            size = number(found, "rows") * number(found, "cols")
            if size != len(data):
                raise CameraError(f"{name} has {len(data)} numbers: expected {size:g}")
        return data
    if isinstance(found, str):
        found = found.split()
    if found is None or not isinstance(found, Sequence):
        raise CameraError(f"{name} is {found!r}: expected a list of numbers")
    flat = [item for row in found for item in (row if isinstance(row, list) else [row])]
    return tuple(_number(name, item) for item in flat)


def flag(values: Values, name: str) -> bool:
    """Return whether a 0/1 or true/false field is on; off if missing."""
    value = values.get(name, False)
    if str(value).lower() not in ("0", "1", "true", "false"):
        raise CameraError(f"{name} is {value!r}: expected 0 or 1")
    return str(value).lower() in ("1", "true")


def size(values: Values) -> tuple[int, int] | None:
    """Return width and height in px; None if the size is not given, or is 0 as drivers write it.

    Read from image_width and image_height, width and height, resolution, Size, or other names.
    """
    sizes = set()
    for width, height in _SIZES:
        if width in values or height in values:
            sizes.add((number(values, width), number(values, height)))
    for name in _SIZE_LISTS:
        if name in values and not isinstance(values[name], Mapping):
            resolution = numbers(values, name)
            if len(resolution) != 2:
                raise CameraError(f"{name} is {list(resolution)}: expected width and height")
            sizes.add((resolution[0], resolution[1]))
    sizes.discard((0, 0))
    if not sizes:
        return None
    if len(sizes) > 1:
        found = " and ".join(f"{width:g}x{height:g}" for width, height in sorted(sizes))
        raise CameraError(f"the image size is {found}: expected one image_width and image_height")
    ((width_px, height_px),) = sizes
    for name, value in (("image width", width_px), ("image height", height_px)):
        if not math.isfinite(value) or value != int(value):
            raise CameraError(f"{name} is {value}: expected whole pixels")
    return int(width_px), int(height_px)


def matrix(values: Values, name: str) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy of a row-major 3x3 camera matrix."""
    found = numbers(values, name)
    if len(found) != 9:
        raise CameraError(f"{name} has {len(found)} numbers: expected 3x3")
    fx, skew, cx, below, fy, cy, *last = found
    if not abs(skew) <= _MOST_SKEW_PX or below != 0:
        raise CameraError(
            f"{name} has a skew of {skew if below == 0 else below:g} px: expected 0, or up to"
            f" {_MOST_SKEW_PX} px, which no measurement sees"
        )
    if last != [0, 0, 1]:
        raise CameraError(f"{name} has {last} as its last row: expected [0, 0, 1]")
    return fx, fy, cx, cy


def camera(
    size_px: tuple[int, int] | None,
    focal_and_centre_px: Sequence[float],
    terms: Sequence[float],
    model: str = RADTAN,
) -> PinholeCamera:
    """Create a camera; zero distortion is dropped, and so are the zeros after its last term.

    Without a size the camera takes that of the pictures, and a warning says so.
    """
    fx, fy, cx, cy = focal_and_centre_px
    lens = _shortened(terms) if model == RADTAN else tuple(terms)
    if size_px is not None:
        return PinholeCamera(*size_px, fx, fy, cx, cy, lens, model)
    found = sizeless_camera(fx, fy, cx, cy, lens, model)
    tell_choice(
        "it gives no image size: that of the pictures is taken, or without pictures"
        f" {found.width}x{found.height} px, twice the principal point"
    )
    return found


def _shortened(terms: Sequence[float]) -> tuple[float, ...]:
    """Drop the groups of OpenCV's terms that are 0, from the last on."""
    if not any(terms):
        return ()
    lens = tuple(terms)
    for count in _GROUPS:
        if len(lens) > count and not any(lens[count:]):
            return lens[:count]
    return lens


def lens_model(name: str, value: Any, models: Mapping[str, str]) -> str:
    """Return the distortion model for a tool's name of it."""
    if not isinstance(value, str) or value not in models:
        raise CameraError(f"{name} is {value!r}: expected {', '.join(models)}")
    return models[value]
