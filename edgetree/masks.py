"""Instance masks: from the model's small in-box grids to image pixels, and to COCO's RLE."""

from __future__ import annotations

from typing import Final, TypedDict

import numpy as np
from numpy.typing import NDArray

__all__ = ["CocoRle", "encode_rle", "paste_mask"]

_ROWS_AT_ONCE: Final = 64  # what is being worked on stays in the processor's cache


class CocoRle(TypedDict):
    """A compressed COCO mask: `size` is [height, width], `counts` the packed run lengths."""

    size: list[int]
    counts: str


def paste_mask(
    probability: NDArray[np.float32],
    box_px: NDArray[np.float32],
    image_width: int,
    image_height: int,
    threshold: float = 0.5,
) -> NDArray[np.bool_]:
    """Spread one in-box mask over the image.

    Args:
        probability: (M, M) values in [0, 1]; cell (r, c) is the r-th of M equal rows and the c-th
            of M equal columns of the box.
        box_px: (4,) x0, y0, x1, y1 in image coordinates (pixel centres at +0.5).
        image_width: width of the result in pixels.
        image_height: height of the result in pixels.
        threshold: pixels whose interpolated probability reaches it are set.

    Returns:
        (image_height, image_width) bool.

    The value at a pixel's centre is the bilinear interpolation between the centres of the cells,
    with zeros beyond the box: the sampling of `grid_sample(align_corners=False)`, as Detectron2's
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
    flat = np.ascontiguousarray(mask.T).reshape(-1)
    changes = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    start = [0] if flat.size and flat[0] else []
    edges = np.concatenate([[0], start, changes, [flat.size]]).astype(np.int64)
    runs = np.diff(edges)
    runs[3:] -= runs[1:-2].copy()
    return {"size": [height, width], "counts": "".join(_pack_run(int(run)) for run in runs)}


def _pack_run(value: int) -> str:
    """One signed number in COCO's base 32 characters."""
    characters = []
    while True:
        digit = value & 0x1F
        value >>= 5
        finished = value == (-1 if digit & 0x10 else 0)
        characters.append(chr((digit if finished else digit | 0x20) + 48))
        if finished:
            return "".join(characters)
