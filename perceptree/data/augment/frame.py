"""Apply all augmentations to one frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calib import DepthEncoding
from perceptree.data.augment.cameras import redraw
from perceptree.data.augment.colour import recolour
from perceptree.data.augment.depth import disturb_depth, level_metres
from perceptree.data.augment.geometry import draw_transform, flip, transform_sample
from perceptree.data.augment.pair import augment_pair
from perceptree.data.augment.paste import paste_trees
from perceptree.data.augment.randomness import is_drawn
from perceptree.data.augment.readings import with_readings
from perceptree.data.augment.views import draw_view, enlarged_smoothly, without_ground
from perceptree.data.frames import Sample
from perceptree.models import ModelSpec
from perceptree.settings.augmentation import AugmentSettings

_REACH = 1.1  # least range of a sensor, over the distance of the nearest tree


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
    if encoding is not None and sample.exact:
        return _through_another_camera(rng, sample, encoding, settings)
    height, width = sample.image.shape[:2]
    sample = transform_sample(sample, draw_transform(rng, width, height, settings), spec.pad_values)
    if encoding is not None and spec.modality == "both":
        return augment_pair(rng, sample, encoding, settings)
    if encoding is None:
        return replace(sample, image=recolour(rng, sample.image, settings))
    image = disturb_depth(rng, sample.image, encoding, settings)
    return with_readings(sample, image, image, encoding)


def _through_another_camera(
    rng: np.random.Generator, sample: Sample, encoding: DepthEncoding, settings: AugmentSettings
) -> Sample:
    """Draw another view of exact depth, and what another camera reads of it."""
    transform, nearer = draw_view(rng, sample, settings)
    sample = transform_sample(sample, transform, encoding.invalid_value, nearest=True)
    seen = enlarged_smoothly(sample.image, float(transform.matrix[1, 1]))
    depth_m = level_metres(encoding)[seen] * np.float32(nearer)
    least_m = 0.0
    if sample.masks is not None and len(sample.masks):
        least_m = _REACH * min(float(np.median(depth_m[mask])) for mask in sample.masks)
        if is_drawn(rng, settings.bare_share):
            depth_m = without_ground(depth_m, np.asarray(sample.masks.any(0)))
    image, dense = redraw(rng, depth_m, encoding, settings, least_m if least_m < np.inf else 0.0)
    return with_readings(sample, image, dense, encoding)
