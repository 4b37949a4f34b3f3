"""Object masks: paste into an image, and convert to COCO run lengths or polygons."""

from __future__ import annotations

from typing import Any, Final, TypedDict

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Bool, Float, Float32

_ROWS_AT_ONCE: Final = 64  # small enough for the processor's cache
_MIN_PART_SHARE = 0.01


class CocoRle(TypedDict):
    """A compressed COCO mask.

    Attributes:
        size: [height, width] in px.
        counts: Packed run lengths.
    """

    size: list[int]
    counts: str


def paste_mask(
    probability: Float,
    box_px: Float,
    image_width: int,
    image_height: int,
    threshold: float = 0.5,
) -> Bool:
    """Resize a mask predicted in a box and paste it into the image.

    The value at a pixel's centre is interpolated bilinearly between the centres of the mask's
    cells, with zeros outside the box. This matches `grid_sample(align_corners=False)` in
    Detectron2's `paste_masks_in_image`. Bilinear interpolation is separable, so two small matrix
    products over the box's pixels are enough.

    Args:
        probability: (M, M) values in [0, 1]; the cells divide the box into M equal rows and
            columns.
        box_px: (4,) x0, y0, x1, y1 in continuous px.
        image_width: Width of the result in px.
        image_height: Height of the result in px.
        threshold: Smallest interpolated probability of a pixel in the mask.

    Returns:
        (image_height, image_width) bool.
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
) -> tuple[slice, Float32]:
    """Return the pixels that [start_px, end_px] touches and their (pixels, cells) weights."""
    first = min(max(int(np.floor(start_px)), 0), image_size)
    last = min(max(int(np.ceil(end_px)), first), image_size)
    if end_px <= start_px or first == last:
        return slice(first, first), np.zeros((0, cells), dtype=np.float32)
    centres_px = np.arange(first, last) + 0.5
    position = (centres_px - start_px) / (end_px - start_px) * cells - 0.5
    weights = 1.0 - np.abs(position[:, None] - np.arange(cells)[None, :])
    return slice(first, last), np.maximum(weights, 0.0).astype(np.float32)


def encode_rle(mask: Bool) -> CocoRle:
    """Encode a (H, W) bool mask as compressed COCO run lengths (`maskApi.c` of pycocotools).

    Runs are counted down the columns, starting with zeros. From the fourth on, each run is stored
    as its difference from the run two before. The numbers are written in base 32, least significant
    digit first: 5 bits of value, 1 bit that says whether another digit follows, plus 48 to make a
    printable character.

    Examples:
        >>> import numpy as np
        >>> encode_rle(np.eye(3, dtype=bool))
        {'size': [3, 3], 'counts': '013000'}
    """
    height, width = mask.shape
    columns = np.flatnonzero(mask.any(axis=0))
    first, last = (int(columns[0]), int(columns[-1]) + 1) if columns.size else (0, 0)
    # Only occupied columns are transposed; a zero before and after them ends the runs.
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
    """Write signed numbers as COCO's base 32 characters."""
    rest, unfinished = values, np.ones(len(values), np.bool_)
    digits, written = [], []
    while unfinished.any():
        digit, rest = rest & 0x1F, rest >> 5
        written.append(unfinished)
        unfinished = unfinished & (rest != np.where(digit & 0x10, -1, 0))
        digits.append(np.where(unfinished, digit | 0x20, digit) + 48)
    characters = np.stack(digits, axis=1).astype(np.uint8)
    return characters[np.stack(written, axis=1)].tobytes().decode("ascii")


def mask_polygons(mask: Bool, tolerance_px: float = 1.0) -> list[list[float]]:
    """Trace the outlines of a mask as COCO polygons.

    Holes are filled. Parts smaller than 1 % of the largest are left out.

    Args:
        mask: (H, W) bool.
        tolerance_px: Largest distance of a polygon from the exact outline.

    Returns:
        Polygons [x, y, x, y, ...] in continuous px with corners on pixel edges, largest first;
        empty for an empty mask.

    Examples:
        >>> import numpy as np
        >>> mask = np.zeros((8, 8), bool)
        >>> mask[2:6, 3:5] = True
        >>> mask_polygons(mask)
        [[3.0, 2.0, 3.0, 6.0, 5.0, 6.0, 5.0, 2.0]]
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return []
    top, left = int(rows[0]), int(columns[0])
    part = mask[top : int(rows[-1]) + 1, left : int(columns[-1]) + 1]
    # Doubled resolution: even coordinates are pixel edges, odd ones pixel centres.
    fine = np.zeros((2 * part.shape[0] + 1, 2 * part.shape[1] + 1), np.uint8)
    fine[1::2, 1::2] = part
    fine = np.asarray(cv2.dilate(fine, np.ones((3, 3), np.uint8)), np.uint8)
    outlines, _ = cv2.findContours(fine, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    corners = [_simplify(outline, 2 * tolerance_px) for outline in outlines]
    areas = np.array([cv2.contourArea(polygon) for polygon in corners])
    kept = [n for n in np.argsort(-areas) if areas[n] > _MIN_PART_SHARE * areas.max()]
    offset = np.array([left, top])
    return [(corners[n][:, 0] / 2 + offset).reshape(-1).tolist() for n in kept]


def _simplify(outline: NDArray[Any], tolerance: float) -> NDArray[Any]:
    """Approximate the outline; keep every corner of one so thin that it would vanish."""
    corners = cv2.approxPolyDP(outline, tolerance, True)
    thin = cv2.contourArea(corners) < 0.5 * cv2.contourArea(outline)
    return np.asarray(cv2.approxPolyDP(outline, 0.5, True) if thin else corners)
