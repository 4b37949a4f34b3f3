"""Tell the parts of a mask that lie beside its stem."""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

_MIN_ELONGATION: Final = 2.0
"""A largest part that is not so many times as long as wide does not tell the stem's direction.

Source: chosen by hand."""

_BESIDE_WIDTHS: Final = 1.5
"""A part is beside the stem if its middle is so many widths of the stem from the stem's axis.

Source: chosen by hand. An arm of a fork that is cut off from its stem may lie further away."""

_LARGE_SHARE: Final = 0.25
"""Parts beside the stem with a smaller share of the pixels of the largest part are specks.

Source: chosen by hand. Of 1,048 true masks of simulated trees, 2 % have a larger part beside the
axis, as a nearer stem hides their middle, and 5 % a smaller one."""


class MaskParts(NamedTuple):
    """The parts of a mask.

    Attributes:
        kept: (H, W) bool, the mask without `specks`.
        specks: Number of small parts that lie beside the stem's axis.
        large: Number of large ones. They may be of the same stem, on both sides of a nearer one.
    """

    kept: NDArray[np.bool_]
    specks: int
    large: int


def mask_parts(mask: NDArray[np.bool_]) -> MaskParts:
    """Look at the connected parts of a mask (H, W) of at least one pixel.

    The axis of the largest part is the line through its pixels (least squares), and its width is
    its area over its length along that line.
    """
    count, labels, stats, middles = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    if count <= 2:
        return MaskParts(mask, 0, 0)
    area_px = stats[:, cv2.CC_STAT_AREA]
    largest = 1 + int(area_px[1:].argmax())
    rows, columns = np.nonzero(labels == largest)
    points = np.column_stack([columns, rows]).astype(np.float32)
    along_x, along_y, x, y = cv2.fitLine(points, cv2.DIST_L2, 0, 0.01, 0.01).ravel().tolist()
    position = points @ np.array([along_x, along_y])
    length_px = float(position.max() - position.min()) + 1
    width_px = area_px[largest] / length_px
    if length_px < _MIN_ELONGATION * width_px:
        return MaskParts(mask, 0, 0)
    off_px = np.abs((middles[:, 0] - x) * along_y - (middles[:, 1] - y) * along_x)
    beside = off_px > _BESIDE_WIDTHS * width_px
    beside[[0, largest]] = False
    large = beside & (area_px >= _LARGE_SHARE * area_px[largest])
    specks = beside & ~large
    return MaskParts(mask & ~specks[labels], int(specks.sum()), int(large.sum()))
