"""Read photographed materials and cut-outs: eight bits, usable sizes, wrapping around."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float, UInt8
from basetree.errors import InputFileError, SettingsError
from basetree.files.reading import read_image
from perceptree.simulator.materials.layers import SIZE_PX
from perceptree.simulator.photographs.folder import Photograph

LARGEST_PX = 1024  # longer side of a material; larger ones are reduced
SMALLEST_PX = 64
_LONGEST_PX = 16_384
_LARGEST_RATIO = 8
SEAM = 2.0  # a seam is seen above this ratio of its difference to that of other neighbours
_COMPARED = 64  # pairs of neighbouring lines
MARGIN = 8  # a seam is blended over this part of a side
_SLOPE = {"height": 0.45, "brightness": 0.3}  # root mean square slope of derived normals
_SOFT_PX = 1.2
_LEAST_OPAQUE = 0.02
DEEP = "reduced to 8 bits a channel"
_GREY = 12  # a cut-out is grey below this mean difference of its channels


@dataclass(frozen=True)
class Material:
    """A photographed surface that wraps around.

    Attributes:
        colour: (H, W, 3) uint8 sRGB.
        slope: (H, W, 2) uint8 x and y of the normals, y up in the picture, 127.5 being zero.
        remarks: What was done to use it.
    """

    colour: UInt8
    slope: UInt8
    remarks: tuple[str, ...]


def load_material(photo: Photograph) -> Material:
    """Read a material; normals come from the map, else the height, else the brightness.

    Raises:
        SettingsError: If a picture is unreadable, too small, too large or too narrow.
    """
    raw = read_picture(photo.files["color"])
    remarks = _remarks(raw)
    colour = reduced(eight_bit_rgb(raw))
    size = colour.shape[1], colour.shape[0]
    slope, source = _slope(photo, colour, size)
    if source != "map":
        remarks.append(f"normals from the {source}")
    seams = [axis for axis in (0, 1) if seam_ratio(colour, axis) > SEAM]
    for axis in seams:
        margin = colour.shape[axis] // MARGIN
        colour, slope = blend_seam(colour, axis, margin), blend_seam(slope, axis, margin)
    if seams:
        remarks.append("made to wrap around by blending its borders")
    return Material(colour, slope, tuple(remarks))


def load_cutout(photo: Photograph) -> tuple[UInt8, bool]:
    """Read a cut-out, and continue its colours where it is transparent.

    Returns:
        (H, W, 3) uint8 sRGB of the opaque part's bounding box, and whether it is grey.

    Raises:
        SettingsError: If it has no alpha channel, or nothing in it is opaque.
    """
    path = photo.files["color"]
    raw = read_picture(path)
    if raw.ndim != 3 or raw.shape[2] != 4:
        raise SettingsError(f"{path}: has no alpha channel, expected a PNG cut out by its alpha")
    every = max(1, max(raw.shape[:2]) // SIZE_PX)
    raw = raw[::every, ::every]
    alpha = raw[..., 3] > np.iinfo(raw.dtype).max // 2
    if alpha.mean() < _LEAST_OPAQUE:
        raise SettingsError(f"{path}: is transparent, expected leaves cut out by its alpha")
    rows, columns = np.flatnonzero(alpha.any(1)), np.flatnonzero(alpha.any(0))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    colour, inside = eight_bit_rgb(raw)[box], alpha[box]
    _, labels = cv2.distanceTransformWithLabels(
        (~inside).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    nearest = np.zeros((labels.max() + 1, 3), np.uint8)
    nearest[labels[inside]] = colour[inside]
    red, green, blue = colour[inside].astype(int).T
    return nearest[labels], bool(np.abs(red - green).mean() + np.abs(green - blue).mean() < _GREY)


def seam_ratio(picture: UInt8, axis: int) -> float:
    """Difference of the first and last line over the median difference of neighbouring lines."""
    lines = np.moveaxis(picture, axis, 0)
    first = np.linspace(0, len(lines) - 2, _COMPARED).astype(int)
    inner = np.abs(lines[first + 1].astype(int) - lines[first]).mean((1, 2))
    return float(np.abs(lines[-1].astype(int) - lines[0]).mean() / max(np.median(inner), 0.5))


def blend_seam(picture: NDArray[Any], axis: int, margin: int) -> NDArray[Any]:
    """Make a picture wrap around: its last lines fade into the first ones, and are cut off."""
    lines = np.moveaxis(picture, axis, 0)
    share = (np.arange(margin, dtype=np.float32) + 0.5) / margin
    share = share.reshape(-1, *[1] * (lines.ndim - 1))
    kept = lines[:-margin].copy()
    kept[:margin] = lines[:margin] * share + lines[-margin:] * (1 - share)
    return np.moveaxis(kept, 0, axis)


def slope_of(height: Float, target: float) -> UInt8:
    """(H, W, 2) x and y of the normals of a height map that wraps around.

    Args:
        height: (H, W) heights of any scale.
        target: Root mean square slope of the result; 0 for a flat map.
    """
    right = np.roll(height, -1, 1) - np.roll(height, 1, 1)
    down = np.roll(height, -1, 0) - np.roll(height, 1, 0)
    size = float(np.sqrt((right**2 + down**2).mean()))
    scale = target / size if size > 0 else 0.0
    length = np.sqrt(1 + scale**2 * (right**2 + down**2))
    return _byte(np.stack([-scale * right / length, scale * down / length], -1) * 127.5 + 127.5)


def _slope(photo: Photograph, colour: UInt8, size: tuple[int, int]) -> tuple[UInt8, str]:
    if "normal" in photo.files:
        normal = eight_bit_rgb(read_picture(photo.files["normal"]))
        scaled = cv2.resize(normal, size, interpolation=cv2.INTER_AREA)
        return np.asarray(scaled[..., :2], np.uint8), "map"
    source, height = "brightness", cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)
    if "height" in photo.files:
        read = read_picture(photo.files["height"], cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
        source, height = "height", cv2.resize(read, size)
    soft = cv2.GaussianBlur(
        height.astype(np.float32), (0, 0), _SOFT_PX, borderType=cv2.BORDER_REFLECT
    )
    return slope_of(np.asarray(soft, np.float32), _SLOPE[source]), source


def read_picture(path: Path, flags: int = cv2.IMREAD_UNCHANGED) -> NDArray[Any]:
    """Read a picture as `cv2.imread` does.

    Raises:
        SettingsError: If it is unreadable, too small, too large or too narrow.
    """
    try:
        picture = read_image(path, flags)
    except InputFileError as error:
        raise SettingsError(str(error)) from error
    if picture is None:
        raise SettingsError(f"{path}: cannot be read as a picture, expected a JPEG or PNG file")
    height, width = picture.shape[:2]
    short, long = min(width, height), max(width, height)
    if short < SMALLEST_PX or long > _LONGEST_PX or long > _LARGEST_RATIO * short:
        raise SettingsError(
            f"{path}: is {width}x{height} px, expected sides of {SMALLEST_PX} to {_LONGEST_PX} px,"
            f" the longer one at most {_LARGEST_RATIO} times the shorter one"
        )
    return picture


def _remarks(raw: NDArray[Any]) -> list[str]:
    height, width = raw.shape[:2]
    remarks = []
    if raw.dtype != np.uint8:
        remarks.append(DEEP)
    if max(width, height) > LARGEST_PX:
        remarks.append(f"reduced to {LARGEST_PX} px")
    if width != height:
        remarks.append("not square, repeated to a square")
    return remarks


def eight_bit_rgb(raw: NDArray[Any]) -> UInt8:
    """(H, W, 3) uint8 RGB of a picture as read: grey or BGR, with or without alpha."""
    if raw.dtype != np.uint8:
        scale = 255.0 / (np.iinfo(raw.dtype).max if raw.dtype.kind == "u" else 1.0)
        raw = _byte(raw * scale)
    if raw.ndim == 2:
        return np.repeat(raw[..., None], 3, -1)
    return np.ascontiguousarray(raw[..., 2::-1])


def _byte(values: Float) -> UInt8:
    return np.asarray(np.clip(values, 0, 255) + 0.5, np.uint8)


def reduced(picture: UInt8, longest_px: int = LARGEST_PX) -> UInt8:
    """Reduce a picture to a longer side of at most `longest_px`."""
    scale = longest_px / max(picture.shape[:2])
    if scale >= 1:
        return picture
    size = round(picture.shape[1] * scale), round(picture.shape[0] * scale)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
