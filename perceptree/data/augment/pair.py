"""Changes of frames with colour and depth: each its own, and those between the two."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from basetree.arrays import UInt8
from calib import DepthEncoding
from perceptree.data.augment.colour import recolour
from perceptree.data.augment.depth import disturb_depth
from perceptree.data.augment.randomness import is_drawn
from perceptree.data.augment.readings import with_readings
from perceptree.data.frames import Sample
from perceptree.settings.augmentation import AugmentSettings


def augment_pair(
    rng: np.random.Generator, sample: Sample, encoding: DepthEncoding, settings: AugmentSettings
) -> Sample:
    """Change the colours and the readings of a frame, move one against the other, leave one out.

    Args:
        rng: Source of the random numbers.
        sample: The frame, whose image is (H, W, 4) with the depth as the last channel.
        encoding: Encoding of the depth.
        settings: Strengths of the changes.
    """
    before = np.ascontiguousarray(sample.image[..., 3])
    colour = recolour(rng, np.ascontiguousarray(sample.image[..., :3]), settings)
    colour = _moved(rng, colour, settings)
    depth = disturb_depth(rng, before, encoding, settings)
    drawn = float(rng.uniform())
    if drawn < settings.without_colour_share:
        colour = np.zeros_like(colour)
        sample = with_readings(replace(sample, image=before), depth, depth, encoding)
    elif drawn < settings.without_colour_share + settings.without_depth_share:
        depth = np.full_like(depth, encoding.invalid_value)
    return replace(sample, image=np.dstack([colour, depth]))


def _moved(rng: np.random.Generator, colour: UInt8, settings: AugmentSettings) -> UInt8:
    """Move a picture by a random distance in a random direction; its border is repeated."""
    if not settings.misaligned_px or not is_drawn(rng, settings.misaligned_share):
        return colour
    angle = float(rng.uniform(0, 2 * math.pi))
    distance_px = float(rng.uniform(0, settings.misaligned_px))
    x, y = distance_px * math.cos(angle), distance_px * math.sin(angle)
    matrix = np.array([[1, 0, x], [0, 1, y]])
    size = (colour.shape[1], colour.shape[0])
    moved = cv2.warpAffine(colour, matrix, size, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, np.uint8)
