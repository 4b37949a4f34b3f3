"""Read colour images, and mask images drawn by hand or made by another segmentation program."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.counts import counted
from basetree.errors import InputError
from basetree.files.headers.exif import orientation_words
from basetree.files.picture_size import most_picture_bytes
from basetree.files.reading import Picture, decode_picture, orientation_note
from basetree.files.regular import read_regular
from edgetree.detections import TreeDetections
from edgetree.frames.mask_parts import mask_parts
from edgetree.frames.pipeline import FoundTrees

_log = logging.getLogger(__name__)

_LOSSLESS: Final = ("PNG", "TIFF", "BMP", "PNM")
_MAX_TREES: Final = 100


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read a colour image as stored, (H, W, 3) uint8 BGR; as `read_colour`."""
    return np.asarray(read_colour(path).pixels, dtype=np.uint8)


def read_colour(path: Path) -> Picture:
    """Read a colour image. Greyscale images are converted to colour.

    Returns:
        Its stored pixels, (H, W, 3) uint8 BGR, and the orientation that it states.

    Raises:
        InputError: The file is missing, not an image, truncated, or has more than 8 bits.
        InputFileError: It has more pixels than `basetree.files.limits.Limits.image_pixels`, or is
            of a format that is not read.
    """
    expected = "expected a complete 8-bit JPEG or PNG image, or TIFF, BMP, WebP, HEIC, GIF or PNM"
    picture = _decoded(path, f"image {path}", cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR, expected)
    if picture.pixels.dtype != np.uint8:
        raise InputError(
            f"image {path} is {picture.pixels.dtype}: expected 8-bit colour; a depth image belongs"
            " to --depth, and alone needs --model depth"
        )
    return picture


def taken_words(orientation: int, upright: bool) -> str:
    """Say how the pixels of a picture that states an EXIF orientation were taken.

    Args:
        orientation: The orientation.
        upright: Whether they were turned as it says.
    """
    taken = "turned upright, as neither depth nor a camera is given"
    if not upright:
        taken = "taken as stored, those of the camera"
    return f"{orientation_words(orientation)}: the pixels are {taken}"


def read_masks(path: Path, size_px: tuple[int, int]) -> FoundTrees:
    """Read a mask image. 0 is background; each other value is the number of a tree.

    Args:
        path: An image with one channel of 8 or 16 bits in a lossless format, such as PNG.
        size_px: Expected width and height.

    Returns:
        The trees, sorted by number, with scores of 1 and without keypoints.

    Raises:
        InputError: The file cannot be read, has another format or size, or does not contain 1 to
            100 trees.
    """
    values = _read_values(path)
    height, width = values.shape
    if (width, height) != size_px:
        raise InputError(
            f"mask {path} is {width}x{height} px{orientation_note(path)}: expected"
            f" {size_px[0]}x{size_px[1]} px, like the image"
        )
    numbers = [int(value) for value in np.unique(values) if value]
    if not 1 <= len(numbers) <= _MAX_TREES:
        raise InputError(
            f"mask {path} contains {len(numbers)} values other than 0: expected one per tree, 1 to"
            f" {_MAX_TREES}"
        )
    masks = np.stack([_without_specks(path, number, values == number) for number in numbers])
    trees = TreeDetections(
        boxes_px=np.array([_box(mask) for mask in masks], np.float32),
        scores=np.ones(len(numbers), np.float32),
        keypoints_px=None,
        masks=None,
        image_width=width,
        image_height=height,
    )
    return FoundTrees(trees, tuple(numbers), masks)


def _without_specks(path: Path, number: int, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(H, W) the mask of a tree without small parts beside its stem; says what lies there."""
    parts = mask_parts(mask)
    if parts.specks:
        _log.warning(
            "mask %s: %s of value %d beside the stem, %d of %d px, %s left out; another tree"
            " needs a number of its own",
            path,
            counted(parts.specks, "small part"),
            number,
            mask.sum() - parts.kept.sum(),
            mask.sum(),
            "is" if parts.specks == 1 else "are",
            extra={"is_remark": True},
        )
    if parts.large:
        _log.warning(
            "mask %s: value %d has %d large parts side by side: if they are different trees, give"
            " each its own number",
            path,
            number,
            parts.large + 1,
            extra={"is_remark": True},
        )
    return parts.kept


def _read_values(path: Path) -> NDArray[np.integer]:
    """(H, W) the values of a mask image."""
    expected = "expected one channel of 8 or 16 bits, 0 for background and a number for each tree"
    picture = _decoded(path, f"mask {path}", cv2.IMREAD_UNCHANGED, expected)
    if picture.format_name not in _LOSSLESS:
        raise InputError(
            f"mask {path} is {picture.format_name}, not in a lossless format: expected a PNG"
        )
    values = picture.pixels
    if values.ndim != 2 or values.dtype not in (np.uint8, np.uint16):
        channels = 1 if values.ndim == 2 else values.shape[2]
        raise InputError(
            f"mask {path} has {counted(channels, 'channel')} of {values.dtype}: {expected}"
        )
    return np.asarray(values)


def _decoded(path: Path, name: str, flags: int, expected: str) -> Picture:
    try:
        data = read_regular(path, most_picture_bytes())
    except OSError as error:
        raise InputError(f"{name} cannot be read ({error.strerror}): {expected}") from error
    picture = decode_picture(data, flags, name)
    if picture is None:
        raise InputError(f"{name} cannot be read ({len(data)} bytes): {expected}")
    return picture


def _box(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """x0, y0, x1, y1 around the set pixels."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
