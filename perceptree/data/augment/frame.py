"""One frame through all changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calib import DepthEncoding
from perceptree.data.augment.colour import recolour
from perceptree.data.augment.depth import disturb_depth, still_read
from perceptree.data.augment.geometry import draw_move, flip, move_sample
from perceptree.data.augment.paste import paste_trees
from perceptree.data.augment.randomness import happens
from perceptree.data.augment.settings import AugmentSettings
from perceptree.data.frames import Sample
from perceptree.models import ModelSpec


def augment(
    rng: np.random.Generator,
    sample: Sample,
    spec: ModelSpec,
    settings: AugmentSettings,
    other: Callable[[], Sample] | None = None,
) -> Sample:
    """Trees of another frame, a move of all, then colours or depth readings.

    Everything follows from ``rng``; ``sample`` stays as it is, and parts that nothing changes are
    shared with it. ``other`` gives another training frame, of the same size; without it nothing is
    pasted.
    """
    encoding = None
    if spec.depth_encoding is not None:
        encoding = DepthEncoding.from_dict(spec.depth_encoding)
    if other is not None and happens(rng, settings.copy_paste_share):
        sample = _with_others(rng, sample, other(), encoding)
    height, width = sample.image.shape[:2]
    sample = move_sample(sample, draw_move(rng, width, height, settings), spec.pad_value)
    if encoding is None:
        return replace(sample, image=recolour(rng, sample.image, settings))
    image = disturb_depth(rng, sample.image, encoding, settings)
    invalid = encoding.invalid_value
    kept = still_read(sample.image, image, invalid, sample.boxes, sample.masks)
    sample = replace(sample, image=image)
    return sample if len(kept) == len(sample.boxes) else _only(sample, kept)


def _only(sample: Sample, kept: list[int]) -> Sample:
    masks = None if sample.masks is None else sample.masks[kept]
    boxes, keypoints = sample.boxes[kept], sample.keypoints[kept]
    return replace(sample, boxes=boxes, keypoints=keypoints, masks=masks)


def _with_others(
    rng: np.random.Generator, sample: Sample, other: Sample, encoding: DepthEncoding | None
) -> Sample:
    """Trees of the other frame, as it is or mirrored."""
    if happens(rng, 0.5):
        other = flip(other)
    return paste_trees(rng, sample, other, encoding)
