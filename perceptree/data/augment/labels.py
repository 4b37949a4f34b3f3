"""Transform the labels of a frame, and remove trees of which too little remains."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from basetree.arrays import Bool, Float, UInt8
from perceptree.keypoints import KEYPOINT_FLIP_PAIRS

MIN_PIXELS = 25
MIN_VISIBLE_SHARE = 0.25
_BITS = 8


def flip_keypoints(keypoints: Float) -> Float:
    """Return a copy of (N, 5, 3) keypoints with left and right swapped."""
    swapped = keypoints.copy()
    for left, right in KEYPOINT_FLIP_PAIRS:
        swapped[:, [left, right]] = swapped[:, [right, left]]
    return swapped


def transform_points(points: Float, matrix: Float) -> Float:
    """Transform (..., 2) points by a (3, 3) matrix."""
    homogeneous = points @ matrix[:, :2].T + matrix[:, 2]
    return np.asarray(homogeneous[..., :2] / homogeneous[..., 2:])


def transform_keypoints(
    keypoints: Float, matrix: Float, window: tuple[int, int, int, int], width: int, height: int
) -> Float:
    """Transform keypoints; those that leave the window or the image become zeros.

    Args:
        keypoints: (N, 5, 3) x, y, flag.
        matrix: (3, 3) transform of continuous px.
        window: x0, y0, x1, y1 of the part of the image that is kept.
        width: Image width in px.
        height: Image height in px.
    """
    found, before = keypoints.copy(), keypoints[..., :2]
    found[..., :2] = transform_points(before, matrix)
    kept = (
        (keypoints[..., 2] > 0)
        & (before >= window[:2]).all(-1)
        & (before <= window[2:]).all(-1)
        & (found[..., :2] >= 0).all(-1)
        & (found[..., :2] < (width, height)).all(-1)
    )
    found[~kept] = 0.0
    return found


def transform_boxes(
    boxes: Float, matrix: Float, window: tuple[int, int, int, int], width: int, height: int
) -> tuple[Float, list[int]]:
    """Transform boxes without masks.

    Exact for scaling and shifting. With rotation, shear or perspective the result bounds the
    transformed corners, which may be larger than the tree.

    Args:
        boxes: (N, 4) x0, y0, x1, y1.
        matrix: (3, 3) transform of continuous px.
        window: x0, y0, x1, y1 of the part of the image that is kept.
        width: Image width in px.
        height: Image height in px.

    Returns:
        The boxes of the trees that are kept, (M, 4), and their indices.
    """
    seen = _seen_boxes(boxes, matrix, window, width, height)
    least = np.maximum(MIN_PIXELS, MIN_VISIBLE_SHARE * _areas(_bounding_boxes(boxes, matrix)))
    kept = np.nonzero(_areas(seen) >= least)[0].tolist()
    return seen[kept], kept


def transform_ignored(
    boxes: Float, matrix: Float, window: tuple[int, int, int, int], width: int, height: int
) -> Float:
    """Transform the (M, 4) boxes of ignored regions as `transform_boxes`; any rest is kept."""
    seen = _seen_boxes(boxes, matrix, window, width, height)
    return seen[_areas(seen) > 0]


def _seen_boxes(
    boxes: Float, matrix: Float, window: tuple[int, int, int, int], width: int, height: int
) -> Float:
    """Return (N, 4) the parts of boxes inside window and image, after the transform."""
    x0, y0, x1, y1 = window
    within = np.clip(boxes, (x0, y0, x0, y0), (x1, y1, x1, y1))
    return np.clip(_bounding_boxes(within, matrix), 0, (width, height, width, height))


def transform_masks(
    masks: Bool, boxes: Float, matrix: Float, transform_plane: Callable[[UInt8], UInt8]
) -> tuple[Float, Bool, list[int]]:
    """Transform masks, eight at a time.

    Each mask is one bit of a byte: nearest-neighbour sampling moves all bits alike, so masks may
    overlap.

    Args:
        masks: (N, H, W) bool.
        boxes: (N, 4) approximate boxes of the masks.
        matrix: (3, 3) transform of continuous px.
        transform_plane: Transforms an (H, W) uint8 image by nearest-neighbour sampling.

    Returns:
        Boxes (M, 4) and masks (M, H, W) of the trees that are kept, and their indices.
    """
    starts = range(0, len(masks), _BITS)
    planes = [transform_plane(_plane(masks[start : start + _BITS])) for start in starts]
    found, bits = np.empty_like(masks), np.empty(masks.shape[1:], np.uint8)
    moved_boxes: list[tuple[int, int, int, int]] = []
    kept: list[int] = []
    for row, (x0, y0, x1, y1) in enumerate(boxes):
        moved = found[len(kept)]
        np.bitwise_and(planes[row // _BITS], np.uint8(1 << row % _BITS), out=bits)
        np.not_equal(bits, 0, out=moved)
        before = cv2.countNonZero(masks[row].view(np.uint8))
        expected = before * _area_scale(matrix, (x0 + x1) / 2, (y0 + y1) / 2)
        if cv2.countNonZero(bits) < max(MIN_PIXELS, MIN_VISIBLE_SHARE * expected):
            continue
        moved_boxes.append(box_of(moved))
        kept.append(row)
    return np.array(moved_boxes, float).reshape(-1, 4), found[: len(kept)], kept


def box_of(mask: Bool) -> tuple[int, int, int, int]:
    """Return x0, y0, x1, y1 of the bounding box of an (H, W) mask."""
    x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
    return x, y, x + width, y + height


def _plane(masks: Bool) -> UInt8:
    """Pack up to eight masks into one (H, W) uint8 image, one bit each."""
    plane: UInt8 = masks[0].astype(np.uint8)
    shifted = np.empty_like(plane)
    for bit, mask in enumerate(masks[1:], 1):
        # Multiplication is ten times as fast as numpy's shift of bytes.
        np.multiply(mask.view(np.uint8), np.uint8(1 << bit), out=shifted)
        np.bitwise_or(plane, shifted, out=plane)
    return plane


def _bounding_boxes(boxes: Float, matrix: Float) -> Float:
    """Return (N, 4) boxes that bound the transformed corners of boxes."""
    corners = transform_points(boxes[:, [[0, 1], [2, 1], [2, 3], [0, 3]]], matrix)
    return np.concatenate([corners.min(1), corners.max(1)], axis=-1)


def _areas(boxes: Float) -> Float:
    return np.asarray((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]))


def _area_scale(matrix: Float, x: float, y: float) -> float:
    """Return the factor by which the transform scales a small area at (x, y)."""
    depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return float(abs(determinant / depth**3))
