"""Masks of single objects: grids within a box to pixels, and pixels to COCO's runs or outlines."""

from __future__ import annotations

from typing import Any, Final, TypedDict

import cv2
import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.floating[Any]]

_ROWS_AT_ONCE: Final = 64  # what is being worked on stays in the processor's cache
_SMALLEST_PART = 0.01


class CocoRle(TypedDict):
    """A compressed COCO mask: ``size`` is [height, width], ``counts`` the packed run lengths."""

    size: list[int]
    counts: str


def paste_mask(
    probability: Float,
    box_px: Float,
    image_width: int,
    image_height: int,
    threshold: float = 0.5,
) -> NDArray[np.bool_]:
    """Spread one mask within a box over the image -> (image_height, image_width) bool.

    ``probability`` (M, M) holds values in [0, 1]; cell (r, c) is the r-th of M equal rows and the
    c-th of M equal columns of ``box_px`` (4,), x0, y0, x1, y1 with (0, 0) at the outer corner of
    the first pixel. Pixels whose interpolated probability reaches ``threshold`` are set.

    The value at a pixel's centre is the bilinear interpolation between the centres of the cells,
    with zeros beyond the box: the sampling of ``grid_sample(align_corners=False)``, as Detectron2's
    aligned paste uses. Bilinear interpolation is separable, so it is two small matrix products
    over the pixels of the box alone.
    """
    x0, y0, x1, y1 = (float(value) for value in box_px)
    result = np.zeros((image_height, image_width), dtype=np.bool_)
    rows, row_weights = _axis_weights(y0, y1, probability.shape[0], image_height)
    columns, column_weights = _axis_weights(x0, x1, probability.shape[1], image_width)
    if row_weights.size and column_weights.size:
        inside = result[rows, columns]
        for start in range(0, len(inside), _ROWS_AT_ONCE):
            part = slice(start, start + _ROWS_AT_ONCE)
            values = row_weights[part] @ probability @ column_weights.T
            np.greater_equal(values, threshold, out=inside[part])
    return result


def _axis_weights(
    start_px: float, end_px: float, cells: int, image_size: int
) -> tuple[slice, NDArray[np.float32]]:
    """The pixels that [start_px, end_px] touches, and their (pixels, cells) bilinear weights."""
    first = min(max(int(np.floor(start_px)), 0), image_size)
    last = min(max(int(np.ceil(end_px)), first), image_size)
    if end_px <= start_px or first == last:
        return slice(first, first), np.zeros((0, cells), dtype=np.float32)
    centres_px = np.arange(first, last) + 0.5
    position = (centres_px - start_px) / (end_px - start_px) * cells - 0.5
    weights = 1.0 - np.abs(position[:, None] - np.arange(cells)[None, :])
    return slice(first, last), np.maximum(weights, 0.0).astype(np.float32)


def encode_rle(mask: NDArray[np.bool_]) -> CocoRle:
    """Pack a (H, W) bool mask as compressed COCO RLE, which every COCO tool reads.

    Runs are counted down the columns, starting with zeros. Each run from the fourth on is stored
    as its difference to the run two before, in base 32 digits, least first: five bits of value
    and one that says that more follow, plus 48 to make it a printable character.
    """
    height, width = mask.shape
    columns = np.flatnonzero(mask.any(axis=0))
    first, last = (int(columns[0]), int(columns[-1]) + 1) if columns.size else (0, 0)
    # Only the columns that hold something are turned; a zero before and behind them closes runs.
    flat = np.zeros((last - first) * height + 2, np.int8)
    flat[1:-1] = np.ascontiguousarray(mask[:, first:last].T).reshape(-1)
    changes = np.flatnonzero(flat[1:] != flat[:-1]) + first * height
    ends = np.concatenate([[0], changes, [mask.size]]).astype(np.int64)
    if changes.size and changes[-1] == mask.size:
        ends = ends[:-1]
    runs = np.diff(ends)
    runs[3:] -= runs[1:-2].copy()
    return {"size": [height, width], "counts": _pack_runs(runs)}


def _pack_runs(values: NDArray[np.int64]) -> str:
    """Signed numbers in COCO's base 32 characters."""
    rest, open_ = values, np.ones(len(values), np.bool_)
    digits, written = [], []
    while open_.any():
        digit, rest = rest & 0x1F, rest >> 5
        written.append(open_)
        open_ = open_ & (rest != np.where(digit & 0x10, -1, 0))
        digits.append(np.where(open_, digit | 0x20, digit) + 48)
    characters = np.stack(digits, axis=1).astype(np.uint8)
    return characters[np.stack(written, axis=1)].tobytes().decode("ascii")


def mask_polygons(mask: NDArray[np.bool_], tolerance_px: float = 1.0) -> list[list[float]]:
    """The outlines of a (H, W) bool mask as COCO polygons [x, y, x, y, ...], largest first.

    Corners lie on the edges of pixels, with (0, 0) at the outer corner of the first pixel, within
    ``tolerance_px`` of the exact outline. Holes are filled, and parts of less than a hundredth of
    the largest are left out. An empty mask has none.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return []
    top, left = int(rows[0]), int(columns[0])
    part = mask[top : int(rows[-1]) + 1, left : int(columns[-1]) + 1]
    # Twice as fine, each pixel with its edges and corners: what is even lies on pixels' edges.
    fine = np.zeros((2 * part.shape[0] + 1, 2 * part.shape[1] + 1), np.uint8)
    fine[1::2, 1::2] = part
    fine = np.asarray(cv2.dilate(fine, np.ones((3, 3), np.uint8)), np.uint8)
    outlines, _ = cv2.findContours(fine, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    corners = [_simplified(outline, 2 * tolerance_px) for outline in outlines]
    areas = np.array([cv2.contourArea(polygon) for polygon in corners])
    kept = [n for n in np.argsort(-areas) if areas[n] > _SMALLEST_PART * areas.max()]
    offset = np.array([left, top])
    return [(corners[n][:, 0] / 2 + offset).reshape(-1).tolist() for n in kept]


def _simplified(outline: NDArray[Any], tolerance: float) -> NDArray[Any]:
    """The outline's main corners; all of them where it is so thin that nothing would be left."""
    corners = cv2.approxPolyDP(outline, tolerance, True)
    thin = cv2.contourArea(corners) < 0.5 * cv2.contourArea(outline)
    return np.asarray(cv2.approxPolyDP(outline, 0.5, True) if thin else corners)
