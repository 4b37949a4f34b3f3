"""Trees of one frame pasted into another, with what then hides what."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib import DepthEncoding
from perceptree.data.augment.depth import level_metres
from perceptree.data.augment.labels import LEAST_PIXELS, LEAST_SHARE, box_of
from perceptree.data.frames import Sample

Float = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]

_MOST_TREES = 3
_SOFT_EDGE_PX = 3
_NEARBY_PX = 2
_VISIBLE, _HIDDEN = 2, 1


@dataclass(frozen=True, eq=False)
class _Pasted:
    mask: Mask
    keypoints: Float


def paste_trees(
    rng: np.random.Generator, sample: Sample, other: Sample, encoding: DepthEncoding | None
) -> Sample:
    """One to three trees of ``other``, drawn at random, put where they stand there.

    With an ``encoding`` the pictures are of depth, and a tree shows only where it is nearer than
    what is there. Colours say nothing of that: there a tree hides all behind it. Masks lose what is
    hidden, hidden keypoints get flag 1, and trees of which too little is left are dropped. Both
    samples need masks; otherwise ``sample`` comes back as it is.
    """
    if sample.masks is None or other.masks is None or not len(other.masks):
        return sample
    image = sample.image.copy()
    drawn = rng.permutation(len(other.masks))[: int(rng.integers(1, _MOST_TREES + 1))]
    pasted = [
        tree
        for row in drawn
        if (tree := _paste_one(image, other, other.masks[row], other.keypoints[row], encoding))
    ]
    if not pasted:
        return sample
    hiding = np.any([tree.mask for tree in pasted], axis=0)
    boxes, keypoints, masks = _behind(sample, sample.masks, hiding)
    return replace(
        sample,
        image=image,
        boxes=np.concatenate([boxes, [box_of(tree.mask) for tree in pasted]]),
        keypoints=np.concatenate([keypoints, [tree.keypoints for tree in pasted]]),
        masks=np.concatenate([masks, [tree.mask for tree in pasted]]),
    )


def _paste_one(
    image: NDArray[np.uint8],
    other: Sample,
    mask: Mask,
    keypoints: Float,
    encoding: DepthEncoding | None,
) -> _Pasted | None:
    """Puts one tree into ``image`` itself; None where too little of it would show."""
    pixels = cv2.countNonZero(mask.view(np.uint8))
    if pixels < LEAST_PIXELS:
        return None
    if encoding is None:
        _blend(image, other.image, mask)
        return _Pasted(mask, keypoints)
    shown = mask & _is_nearer(image, other.image, mask, encoding)
    if cv2.countNonZero(shown.view(np.uint8)) < max(LEAST_PIXELS, LEAST_SHARE * pixels):
        return None
    image[shown] = other.image[shown]
    nearby = np.ones((2 * _NEARBY_PX + 1,) * 2, np.uint8)
    around = cv2.dilate(shown.view(np.uint8), nearby).astype(bool)
    return _Pasted(shown, _with_hidden(keypoints, ~around))


def _blend(image: NDArray[np.uint8], other: NDArray[np.uint8], mask: Mask) -> None:
    """Puts the pixels of a mask into ``image`` itself, its edge mixed with what is there."""
    x0, y0, x1, y1 = box_of(mask)
    rows, columns = slice(max(0, y0 - 1), y1 + 1), slice(max(0, x0 - 1), x1 + 1)
    sides = (_SOFT_EDGE_PX, _SOFT_EDGE_PX)
    weight = cv2.blur(mask[rows, columns].astype(np.float32), sides)[..., None]
    there = image[rows, columns]
    mixed = there + weight * (other[rows, columns].astype(np.float32) - there)
    there[:] = np.rint(mixed).astype(np.uint8)


def _is_nearer(
    image: NDArray[np.uint8], other: NDArray[np.uint8], mask: Mask, encoding: DepthEncoding
) -> Mask:
    """(H, W) where a tree is nearer than the picture; where it has no reading, its median is."""
    metres_of = level_metres(encoding)
    theirs = metres_of[other]
    readings = theirs[mask & np.isfinite(theirs)]
    if not readings.size:
        return np.zeros(mask.shape, bool)
    theirs[~np.isfinite(theirs)] = np.median(readings)
    return np.asarray(theirs < metres_of[image])


def _behind(sample: Sample, masks: Mask, hiding: Mask) -> tuple[Float, Float, Mask]:
    """Boxes, keypoints and masks of the frame's own trees that still show enough."""
    left = masks & ~hiding
    boxes, keypoints = sample.boxes.copy(), _with_hidden(sample.keypoints, hiding)
    kept: list[int] = []
    for row, (before, after) in enumerate(zip(masks, left, strict=True)):
        was, now = (cv2.countNonZero(mask.view(np.uint8)) for mask in (before, after))
        if now == was:
            kept.append(row)
        elif now >= max(LEAST_PIXELS, LEAST_SHARE * was):
            boxes[row] = box_of(after)
            kept.append(row)
    return boxes[kept], keypoints[kept], left[kept]


def _with_hidden(keypoints: Float, hiding: Mask) -> Float:
    """(..., 3) keypoints, those that were visible and lie where something hides flagged so."""
    height, width = hiding.shape
    x = np.clip(keypoints[..., 0].astype(int), 0, width - 1)
    y = np.clip(keypoints[..., 1].astype(int), 0, height - 1)
    found = keypoints.copy()
    found[..., 2] = np.where((found[..., 2] == _VISIBLE) & hiding[y, x], _HIDDEN, found[..., 2])
    return found
