"""Apply all augmentations to one frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calib import DepthEncoding
from perceptree.data.augment.colour import recolour
from perceptree.data.augment.depth import disturb_depth, trees_still_read
from perceptree.data.augment.geometry import draw_transform, flip, transform_sample
from perceptree.data.augment.paste import paste_trees
from perceptree.data.augment.randomness import is_drawn
from perceptree.data.frames import Sample
from perceptree.models import ModelSpec
from perceptree.settings.augmentation import AugmentSettings


def augment(
    rng: np.random.Generator,
    sample: Sample,
    spec: ModelSpec,
    settings: AugmentSettings,
    other: Callable[[], Sample] | None = None,
) -> Sample:
    """Augment a frame: paste trees of another frame, move everything, then change colours or depth.

    Deterministic for a given state of `rng`. The input is not changed; unchanged arrays are
    shared with the result.

    Args:
        rng: Source of the random numbers.
        sample: The frame, in model px.
        spec: The model; its modality selects colour or depth changes.
        settings: Strengths of the changes.
        other: Returns another training frame of the same size to paste trees from. Without it
            nothing is pasted.
    """
    encoding = None
    if spec.depth_encoding is not None:
        encoding = DepthEncoding.from_dict(spec.depth_encoding)
    if other is not None and is_drawn(rng, settings.copy_paste_share):
        theirs = other()
        if is_drawn(rng, 0.5):
            theirs = flip(theirs)
        sample = paste_trees(rng, sample, theirs, encoding)
    height, width = sample.image.shape[:2]
    sample = transform_sample(sample, draw_transform(rng, width, height, settings), spec.pad_value)
    if encoding is None:
        return replace(sample, image=recolour(rng, sample.image, settings))
    image = disturb_depth(rng, sample.image, encoding, settings)
    invalid = encoding.invalid_value
    kept = trees_still_read(sample.image, image, invalid, sample.boxes, sample.masks)
    sample = replace(sample, image=image)
    return sample if len(kept) == len(sample.boxes) else _select_trees(sample, kept)


def _select_trees(sample: Sample, kept: list[int]) -> Sample:
    masks = None if sample.masks is None else sample.masks[kept]
    boxes, keypoints = sample.boxes[kept], sample.keypoints[kept]
    return replace(sample, boxes=boxes, keypoints=keypoints, masks=masks)
