"""The depth image that a HEIF file holds beside its picture, by `pillow-heif`.

What its values are is in the file as a message of the codec: ITU-T H.265, "depth representation
information". Inverse depth and depth have their limits in metres. Phones with two cameras write
disparities, which the distance of the cameras and the focal length would make metres.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from basetree.files.headers.exif import INVERSE, UPRIGHT, turned_upright
from basetree.files.headers.header import DepthNote

_INVERSE_DEPTH, _DISPARITY, _DEPTH, _UNEVEN = 0, 1, 2, 3
_SIDEWAYS: Final = (5, 6, 7, 8)
_SHOWN_M: Final = 3.0
_FARTHEST_M: Final = 1000.0
_MOST_OFF: Final = 0.02


def depth_note(picture: Any, orientation: int) -> DepthNote | None:
    """What the depth image of an opened file is; None if there is none.

    Args:
        picture: The main picture, of pillow-heif.
        orientation: EXIF orientation of the picture.
    """
    images = picture.info.get("depth_images")
    if not images:
        return None
    said = images[0].info.get("metadata") or {}
    kind = said.get("representation_type")
    if kind in (_DISPARITY, _UNEVEN):
        limits = [said.get(name) for name in ("d_min", "d_max")]
        words = "of disparities" + (
            f" from {limits[0]:.3g} to {limits[1]:.3g}" if None not in limits else ""
        )
        return DepthNote(f"{words}, without the distance of the cameras that made them", False)
    limits_m = _limits_m(said)
    if limits_m is None:
        return DepthNote("without a word on what its values are", False)
    near_m, far_m = limits_m
    words = f"of {near_m:.3g} to {far_m:.3g} m"
    if orientation not in (UPRIGHT, *_SIDEWAYS):
        return DepthNote(f"{words}, of a picture upside down or mirrored", False)
    levels = _levels(images[0])
    at_m = min(_SHOWN_M, far_m)
    step_m = (far_m - near_m) / levels
    if kind == _INVERSE_DEPTH:
        step_m = at_m**2 * (1 / near_m - 1 / far_m) / levels
    words += f" in {levels} steps, {100 * step_m:.2g} cm apart at {at_m:.3g} m"
    return DepthNote(words, True)


def depth_metres(picture: Any, orientation: int) -> NDArray[np.float32] | None:
    """The depth in metres in the stored pixels of the picture, for a note that says metres.

    Values at both limits stand for what is nearer and farther, too: they are 0, no reading.

    Args:
        picture: The main picture, of pillow-heif.
        orientation: EXIF orientation of the picture.

    Returns:
        (H, W) float32; None if the values cannot be decoded, or are of another form than those of
        the picture.
    """
    image = picture.info["depth_images"][0]
    width, height = picture.size
    limits_m = _limits_m(image.info["metadata"])
    if limits_m is None or image.size[0] * image.size[1] > width * height:
        return None
    try:
        values = np.asarray(image)
    except (OSError, ValueError, RuntimeError, EOFError, SyntaxError):
        return None
    values = values[..., 0] if values.ndim == 3 else values
    levels = _levels(image)
    share = values / np.float32(levels)
    near, far = limits_m
    if image.info["metadata"]["representation_type"] == _INVERSE_DEPTH:
        depth_m = 1 / (1 / far + share * (1 / near - 1 / far))
    else:
        depth_m = near + share * (far - near)
    known_m = np.where((values > 0) & (values < levels), depth_m, 0).astype(np.float32)
    return _stored(known_m, orientation, width, height)


def _stored(
    depth_m: NDArray[np.float32], orientation: int, width: int, height: int
) -> NDArray[np.float32] | None:
    """Depth in the stored pixels of a picture, whose size is that of the upright one."""
    size = (height, width)
    if orientation in _SIDEWAYS:
        size = (width, height)
        if _has_form(depth_m, (height, width)):
            depth_m = turned_upright(depth_m, INVERSE.get(orientation, orientation))
    if not _has_form(depth_m, size):
        return None
    rows, columns = (
        np.arange(whole) * own // whole for whole, own in zip(size, depth_m.shape, strict=True)
    )
    return np.ascontiguousarray(depth_m[np.ix_(rows, columns)])


def _has_form(depth_m: NDArray[np.float32], size: tuple[int, int]) -> bool:
    ratio = depth_m.shape[0] * size[1] / (depth_m.shape[1] * size[0])
    return abs(ratio - 1) < _MOST_OFF and size[0] != size[1]


def _levels(image: Any) -> int:
    """The largest value."""
    return 255 if image.mode == "L" else 65_535


def _limits_m(said: Mapping[str, Any]) -> tuple[float, float] | None:
    """The nearest and the farthest distance; None if the file does not say them."""
    near, far = said.get("z_near"), said.get("z_far")
    if said.get("representation_type") not in (_INVERSE_DEPTH, _DEPTH):
        return None
    if not (isinstance(near, float) and isinstance(far, float) and math.isfinite(far)):
        return None
    return (near, far) if 0 < near < far <= _FARTHEST_M else None
