"""Draw how another camera looks at a frame: shape of its picture, focal length and place."""

from __future__ import annotations

import math

import cv2
import numpy as np

from basetree.arrays import Bool, Float32, UInt8
from calib import Letterbox
from perceptree.data.augment.geometry import Transform
from perceptree.data.augment.randomness import is_drawn
from perceptree.data.frames import Sample
from perceptree.settings.augmentation import AugmentSettings

_LANDSCAPE, _PORTRAIT = (1.25, 1.8), (0.5, 0.8)
_SIDE_PX = 1000  # of a picture whose shape alone matters
_CLOSE = 1.3  # zoom from which a picture is taken of a tree
_GROUND_SHARE = 0.15  # height above the ground, over the camera's, below which a reading is ground
_SKY_PER_M = 0.01  # inverse depth of the ground at the horizon, 1/m
_LEAST_GROUND_PX = 50
_FITS = 4


def draw_log(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    """Draw a number uniformly in its logarithm."""
    return float(math.exp(rng.uniform(math.log(limits[0]), math.log(limits[1]))))


def draw_view(
    rng: np.random.Generator, sample: Sample, settings: AugmentSettings
) -> tuple[Transform, float]:
    """Draw the picture of another camera, at the upper left as `Letterbox` places it.

    Args:
        rng: Source of the random numbers.
        sample: The frame; a strong zoom is centred on one of its trees.
        settings: Ranges of the draws.

    Returns:
        The transform of the frame, and the factor of its depth: a zoom is partly a longer focal
        length, and partly a camera that is nearer.
    """
    height, width = sample.image.shape[:2]
    mirrored = is_drawn(rng, settings.flip_share)
    portrait = is_drawn(rng, settings.portrait_share)
    aspect = float(rng.uniform(*(_PORTRAIT if portrait else _LANDSCAPE)))
    box = Letterbox.fit(round(aspect * _SIDE_PX), _SIDE_PX, width, height)
    zoom = draw_log(rng, settings.camera_zoom)
    if portrait:
        zoom = max(zoom, 1.0)
    target = (box.resized_width, box.resized_height)
    seen = [max(1, min(n, round(t / zoom))) for n, t in zip((width, height), target, strict=True)]
    centre = rng.uniform(0, 1, 2) * (width, height)
    if zoom > _CLOSE and len(sample.boxes):
        x0, y0, x1, y1 = sample.boxes[int(rng.integers(len(sample.boxes)))]
        centre = (x0, y0) + rng.uniform(0, 1, 2) * (x1 - x0, y1 - y0)
    x, y = (
        int(np.clip(round(c - s / 2), 0, n - s))
        for c, s, n in zip(centre, seen, (width, height), strict=True)
    )
    if is_drawn(rng, settings.above_share):
        y = 0
    # A mirrored result is placed at the right: it is moved there before.
    across, down = (min(t, round(s * zoom)) for t, s in zip(target, seen, strict=True))
    left = width - across if mirrored else 0
    source = (x, y, x + seen[0], y + seen[1])
    placed = (left, 0, left + across, down)
    transform = Transform(width, height, (0, 0, width, height), source, placed, mirrored)
    return transform, float(max(zoom, 1.0) ** -rng.uniform(0, 1))


def without_ground(depth_m: Float32, trees: Bool) -> Float32:
    """Remove the readings of the ground.

    The inverse depth of a plane is linear in the picture. Readings of no tree in the lower half
    give the plane by least squares; those well nearer than it are left out of the next fit.

    Args:
        depth_m: (H, W) metres, infinite where there is no reading.
        trees: (H, W) pixels of trees, which stay.

    Returns:
        (H, W) metres; unchanged without enough readings.
    """
    inverse = (1 / depth_m).astype(np.float32)
    rows, columns = np.nonzero(np.isfinite(depth_m) & ~trees)
    low = rows > depth_m.shape[0] // 2
    rows, columns = rows[low][::7], columns[low][::7]
    if len(rows) < _LEAST_GROUND_PX:
        return depth_m
    near = inverse[rows, columns]
    terms = np.stack([columns, rows, np.ones(len(rows))], 1).astype(np.float64)
    used = np.ones(len(rows), bool)
    for _ in range(_FITS):
        plane = np.linalg.lstsq(terms[used], near[used], rcond=None)[0]
        used = near < (terms @ plane) * (1 + _GROUND_SHARE) + _SKY_PER_M
        if used.sum() < _LEAST_GROUND_PX:
            return depth_m
    height, width = depth_m.shape
    ground = plane[0] * np.arange(width)[None] + plane[1] * np.arange(height)[:, None] + plane[2]
    is_ground = (inverse < ground * (1 + _GROUND_SHARE) + _SKY_PER_M) & (ground > 0) & ~trees
    return np.where(is_ground, np.float32(np.inf), depth_m)


def enlarged_smoothly(image: UInt8, zoom: float) -> UInt8:
    """Smooth the steps of an image that was enlarged by the nearest pixel."""
    side = min(2 * round(zoom / 2) + 1, 7)
    return np.asarray(cv2.medianBlur(image, side), np.uint8) if side > 1 else image
