"""Geometric augmentation: flip, crop, scale, shift, rotation, shear, perspective in one step.

Coordinates are continuous px. OpenCV's warps have pixel centres at whole numbers;
`_to_opencv` converts a transform.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np

from basetree.arrays import Bool, Float, UInt8
from perceptree.data.augment.labels import (
    flip_keypoints,
    transform_boxes,
    transform_ignored,
    transform_keypoints,
    transform_masks,
)
from perceptree.data.augment.randomness import is_drawn, uniform_symmetric
from perceptree.data.frames import Sample
from perceptree.settings.augmentation import GeometrySettings

Rectangle = tuple[int, int, int, int]
"""x0, y0, x1, y1 in integer px."""


def flip(sample: Sample) -> Sample:
    """Mirror a frame horizontally; left and right diameter keypoints are swapped."""
    width = sample.image.shape[1]
    boxes, ignored = sample.boxes.copy(), sample.ignored.copy()
    boxes[:, [0, 2]] = width - sample.boxes[:, [2, 0]]
    ignored[:, [0, 2]] = width - sample.ignored[:, [2, 0]]
    keypoints = flip_keypoints(sample.keypoints)
    labelled = keypoints[..., 2] > 0
    keypoints[..., 0] = np.where(labelled, width - keypoints[..., 0], keypoints[..., 0])
    masks = None if sample.masks is None else _mirrored(sample.masks)
    image = np.asarray(cv2.flip(sample.image, 1), np.uint8)
    return replace(
        sample, image=image, boxes=boxes, keypoints=keypoints, masks=masks, ignored=ignored
    )


def _mirrored(masks: Bool) -> Bool:
    mirrored = np.empty_like(masks)
    for row, mask in enumerate(masks):
        mirrored[row] = cv2.flip(mask.view(np.uint8), 1)
    return mirrored


@dataclass(frozen=True, eq=False)
class Transform:
    """A geometric transform of an image to one of the same size.

    First `window` is cut out and, if given, `warp` is applied. Then `source` is resized to
    `target`, and the result may be mirrored.

    Attributes:
        width: Image width in px.
        height: Image height in px.
        window: Part of the image to keep.
        source: Rectangle in the image.
        target: Rectangle in the result that `source` fills.
        mirrored: Whether the result is mirrored horizontally.
        warp: (3, 3) rotation, shear and perspective in continuous px; None for none.
    """

    width: int
    height: int
    window: Rectangle
    source: Rectangle
    target: Rectangle
    mirrored: bool = False
    warp: Float | None = None

    @property
    def matrix(self) -> Float:
        """(3, 3) transform from the image's to the result's continuous px."""
        x0, y0, x1, y1 = self.source
        u0, v0, u1, v1 = self.target
        across, down = (u1 - u0) / (x1 - x0), (v1 - v0) / (y1 - y0)
        matrix = np.array([[across, 0, u0 - across * x0], [0, down, v0 - down * y0], [0, 0, 1.0]])
        if self.mirrored:
            matrix = np.array([[-1.0, 0, self.width], [0, 1, 0], [0, 0, 1]]) @ matrix
        return matrix if self.warp is None else matrix @ self.warp

    @property
    def is_identity(self) -> bool:
        """Whether the transform changes nothing."""
        whole = (0, 0, self.width, self.height)
        still = self.window == self.source == self.target == whole
        return still and not self.mirrored and self.warp is None

    def apply(self, image: UInt8, pad_value: int | tuple[int, ...], nearest: bool) -> UInt8:
        """Transform an image.

        Args:
            image: (H, W) or (H, W, C) uint8.
            pad_value: Grey value where the result is empty, or that of each channel.
            nearest: Use the nearest pixel instead of bilinear interpolation.

        Returns:
            The same shape.
        """
        if self.warp is None:
            return self._resize_and_place(image, pad_value, nearest)
        x0, y0, x1, y1 = self.window
        matrix = _to_opencv(self.matrix @ np.array([[1.0, 0, x0], [0, 1, y0], [0, 0, 1]]))
        interpolation = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
        patch, size = image[y0:y1, x0:x1], (self.width, self.height)
        border = pad_value if isinstance(pad_value, tuple) else (pad_value,) * 3
        warp: Any = cv2.warpPerspective
        if np.allclose(matrix[2], (0, 0, 1)):
            warp, matrix = cv2.warpAffine, matrix[:2]
        warped = warp(patch, matrix, size, flags=interpolation, borderValue=border)
        return np.asarray(warped, np.uint8)

    def _resize_and_place(
        self, image: UInt8, pad_value: int | tuple[int, ...], nearest: bool
    ) -> UInt8:
        """Do the same for axis-aligned rectangles, five times as fast as a warp."""
        x0, y0, x1, y1 = self.source
        u0, v0, u1, v1 = self.target
        interpolation = cv2.INTER_NEAREST_EXACT if nearest else cv2.INTER_LINEAR
        patch, size = image[y0:y1, x0:x1], (u1 - u0, v1 - v0)
        if size != (x1 - x0, y1 - y0):
            patch = np.asarray(cv2.resize(patch, size, interpolation=interpolation), np.uint8)
        if self.mirrored:
            patch = np.asarray(cv2.flip(patch, 1), np.uint8)
            u0, u1 = self.width - u1, self.width - u0
        if patch.shape == image.shape:
            return patch
        placed = np.full_like(image, pad_value)
        placed[v0:v1, u0:u1] = patch
        return placed


def draw_transform(
    rng: np.random.Generator, width: int, height: int, settings: GeometrySettings
) -> Transform:
    """Draw a random transform of an image of this size."""
    mirrored = is_drawn(rng, settings.flip_share)
    sides, window = (width, height), (0, 0, width, height)
    if is_drawn(rng, settings.crop_share):
        kept = [max(1, round(n * share)) for n, share in zip(sides, settings.crop, strict=True)]
        x0, y0 = (int(rng.integers(n - k + 1)) for n, k in zip(sides, kept, strict=True))
        window = (x0, y0, x0 + kept[0], y0 + kept[1])
    wide, tall = window[2] - window[0], window[3] - window[1]
    scale = min(width / wide, height / tall) * _draw_scale(rng, settings.scale)
    across = _draw_span(rng, window[0], wide, width, scale)
    down = _draw_span(rng, window[1], tall, height, scale)
    source, target = ((across[k], down[k], across[k + 1], down[k + 1]) for k in (0, 2))
    warp = _draw_warp(rng, window, settings)
    return Transform(width, height, window, source, target, mirrored, warp)


def transform_sample(
    sample: Sample, transform: Transform, pad_value: int | tuple[int, ...], nearest: bool = False
) -> Sample:
    """Transform image and labels; trees of which too little remains are removed.

    Args:
        sample: The frame.
        transform: The transform.
        pad_value: Grey value where the image is empty, or that of each channel.
        nearest: Take the nearest pixel of the image instead of interpolating.
    """
    if transform.is_identity:
        return sample
    matrix = transform.matrix
    image = transform.apply(sample.image, pad_value, nearest)
    if sample.masks is None:
        boxes, kept = transform_boxes(
            sample.boxes, matrix, transform.window, transform.width, transform.height
        )
        masks = None
    else:
        transform_plane = partial(transform.apply, pad_value=0, nearest=True)
        boxes, masks, kept = transform_masks(sample.masks, sample.boxes, matrix, transform_plane)
    keypoints = sample.keypoints[kept]
    if transform.mirrored:
        keypoints = flip_keypoints(keypoints)
    keypoints = transform_keypoints(
        keypoints, matrix, transform.window, transform.width, transform.height
    )
    ignored = transform_ignored(
        sample.ignored, matrix, transform.window, transform.width, transform.height
    )
    return replace(
        sample, image=image, boxes=boxes, keypoints=keypoints, masks=masks, ignored=ignored
    )


def _draw_scale(rng: np.random.Generator, scales: tuple[float, float]) -> float:
    if scales[0] == scales[1]:
        return float(scales[0])
    return float(np.exp(rng.uniform(*np.log(scales))))


def _draw_span(
    rng: np.random.Generator, start: int, length: int, room: int, scale: float
) -> tuple[int, int, int, int]:
    """Place the scaled window along one axis.

    Returns:
        Start and end in the source, start and end in the target, in integer px.
    """
    placed = max(1, round(length * scale))
    if placed <= room:
        free = int(rng.integers(room - placed + 1))
        return start, start + length, free, free + placed
    seen = max(1, min(length, round(room / scale)))
    first = start + int(rng.integers(length - seen + 1))
    return first, first + seen, 0, room


def _draw_warp(
    rng: np.random.Generator, window: Rectangle, settings: GeometrySettings
) -> Float | None:
    """Draw rotation and shear about a window's centre, then perspective; None if all are off."""
    start, size = np.array(window[:2], np.float64), np.subtract(window[2:], window[:2])
    angle = math.radians(uniform_symmetric(rng, settings.rotation_deg))
    slope = math.tan(math.radians(uniform_symmetric(rng, settings.shear_deg)))
    warp = np.eye(3)
    if angle or slope:
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        warp[:2, :2] = turn @ np.array([[1, slope], [0, 1]])
        centre = start + size / 2
        warp[:2, 2] = centre - warp[:2, :2] @ centre
    if settings.perspective > 0 and is_drawn(rng, settings.perspective_share):
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        inwards = rng.uniform(0, settings.perspective, (4, 2)) * (1 - 2 * corners)
        inner, outer = (start + share * size for share in (corners + inwards, corners))
        pulled = cv2.getPerspectiveTransform(inner.astype(np.float32), outer.astype(np.float32))
        warp = pulled @ warp
    elif not angle and not slope:
        return None
    return warp


def _to_opencv(matrix: Float) -> Float:
    """Convert a transform to coordinates with pixel centres at whole numbers."""
    there, back = np.eye(3), np.eye(3)
    there[:2, 2], back[:2, 2] = 0.5, -0.5
    centred = back @ matrix @ there
    return np.asarray(centred / centred[2, 2])
