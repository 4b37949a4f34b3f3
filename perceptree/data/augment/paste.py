"""Paste trees of one frame into another, with occlusion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from basetree.arrays import Bool, Float, UInt8
from calib import DepthEncoding
from perceptree.data.augment.depth import level_metres
from perceptree.data.augment.labels import MIN_PIXELS, MIN_VISIBLE_SHARE, box_of
from perceptree.data.frames import Sample

_MAX_TREES = 3
_SOFT_EDGE_PX = 3
_NEARBY_PX = 2
_VISIBLE, _HIDDEN = 2, 1


@dataclass(frozen=True, eq=False)
class _Pasted:
    mask: Bool
    keypoints: Float


def paste_trees(
    rng: np.random.Generator, sample: Sample, other: Sample, encoding: DepthEncoding | None
) -> Sample:
    """Paste one to three random trees of `other` at the same position.

    With an `encoding`, the images are depth: a pasted tree is visible only where it is nearer
    than the frame, also in images of both. In colour images it occludes everything behind it.
    Occluded parts are removed from the masks, occluded keypoints get flag 1, and trees of which too
    little is visible are removed.

    Args:
        rng: Source of the random numbers.
        sample: Frame to paste into.
        other: Frame to take trees from, of the same size.
        encoding: Encoding of depth images; None for colour.

    Returns:
        The frame with the pasted trees; `sample` itself if a frame has no masks or nothing fits.
    """
    if sample.masks is None or other.masks is None or not len(other.masks):
        return sample
    image = sample.image.copy()
    drawn = rng.permutation(len(other.masks))[: int(rng.integers(1, _MAX_TREES + 1))]
    pasted = [
        tree
        for row in drawn
        if (tree := _paste_one(image, other, other.masks[row], other.keypoints[row], encoding))
    ]
    if not pasted:
        return sample
    occluder = np.any([tree.mask for tree in pasted], axis=0)
    boxes, keypoints, masks = _occluded_labels(sample, sample.masks, occluder)
    return replace(
        sample,
        image=image,
        boxes=np.concatenate([boxes, [box_of(tree.mask) for tree in pasted]]),
        keypoints=np.concatenate([keypoints, [tree.keypoints for tree in pasted]]),
        masks=np.concatenate([masks, [tree.mask for tree in pasted]]),
    )


def _paste_one(
    image: UInt8,
    other: Sample,
    mask: Bool,
    keypoints: Float,
    encoding: DepthEncoding | None,
) -> _Pasted | None:
    """Paste one tree into `image` in place; None if too little of it would be visible."""
    pixels = cv2.countNonZero(mask.view(np.uint8))
    if pixels < MIN_PIXELS:
        return None
    if encoding is None:
        _blend(image, other.image, mask)
        return _Pasted(mask, keypoints)
    shown = mask & _is_nearer(image, other.image, mask, encoding)
    if cv2.countNonZero(shown.view(np.uint8)) < max(MIN_PIXELS, MIN_VISIBLE_SHARE * pixels):
        return None
    image[shown] = other.image[shown]
    nearby = np.ones((2 * _NEARBY_PX + 1,) * 2, np.uint8)
    around = cv2.dilate(shown.view(np.uint8), nearby).astype(bool)
    return _Pasted(shown, _flag_occluded(keypoints, ~around))


def _blend(image: UInt8, other: UInt8, mask: Bool) -> None:
    """Copy the pixels of a mask into `image` in place, blended at the mask's edge."""
    x0, y0, x1, y1 = box_of(mask)
    rows, columns = slice(max(0, y0 - 1), y1 + 1), slice(max(0, x0 - 1), x1 + 1)
    sides = (_SOFT_EDGE_PX, _SOFT_EDGE_PX)
    weight = cv2.blur(mask[rows, columns].astype(np.float32), sides)[..., None]
    there = image[rows, columns]
    mixed = there + weight * (other[rows, columns].astype(np.float32) - there)
    there[:] = np.rint(mixed).astype(np.uint8)


def _is_nearer(image: UInt8, other: UInt8, mask: Bool, encoding: DepthEncoding) -> Bool:
    """Return (H, W) where a tree is nearer than the frame; its missing readings get its median."""
    metres_of = level_metres(encoding)
    image, other = (each[..., 3] if each.ndim == 3 else each for each in (image, other))
    theirs = metres_of[other]
    readings = theirs[mask & np.isfinite(theirs)]
    if not readings.size:
        return np.zeros(mask.shape, bool)
    theirs[~np.isfinite(theirs)] = np.median(readings)
    return np.asarray(theirs < metres_of[image])


def _occluded_labels(sample: Sample, masks: Bool, occluder: Bool) -> tuple[Float, Float, Bool]:
    """Return boxes, keypoints and masks of the frame's own trees that remain visible enough."""
    left = masks & ~occluder
    boxes, keypoints = sample.boxes.copy(), _flag_occluded(sample.keypoints, occluder)
    kept: list[int] = []
    for row, (before, after) in enumerate(zip(masks, left, strict=True)):
        was, now = (cv2.countNonZero(mask.view(np.uint8)) for mask in (before, after))
        if now == was:
            kept.append(row)
        elif now >= max(MIN_PIXELS, MIN_VISIBLE_SHARE * was):
            boxes[row] = box_of(after)
            kept.append(row)
    return boxes[kept], keypoints[kept], left[kept]


def _flag_occluded(keypoints: Float, occluder: Bool) -> Float:
    """Set the flag of visible (..., 3) keypoints inside the occluder to hidden."""
    height, width = occluder.shape
    x = np.clip(keypoints[..., 0].astype(int), 0, width - 1)
    y = np.clip(keypoints[..., 1].astype(int), 0, height - 1)
    found = keypoints.copy()
    found[..., 2] = np.where((found[..., 2] == _VISIBLE) & occluder[y, x], _HIDDEN, found[..., 2])
    return found
