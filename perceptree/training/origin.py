"""What a checkpoint tells of its frames: scenes of the simulator and looks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from basetree.arrays import UInt8
from calib import DepthEncoding, Letterbox, picture_statistics, usual_ranges
from perceptree.data import FrameRecord
from perceptree.data.cache import FrameCache
from perceptree.data.check.leakage import scene_of
from perceptree.data.frames import source_path
from perceptree.models import ModelSpec
from perceptree.simulator.dataset.scene_job import MAX_SCENES

_MOST_PICTURES = 300


def simulated_scenes(frames: Sequence[FrameRecord]) -> list[dict[str, int]]:
    """The scenes of simulated frames, by the seed of their dataset.

    Args:
        frames: Frames of train splits; those that are not simulated are left out.

    Returns:
        For each seed `seed`, `scenes` (all scenes of this seed have lower numbers) and
        `frames`.
    """
    numbers: dict[int, list[int]] = {}
    for frame in frames:
        seed = scene_of(frame)
        if isinstance(seed, int):
            dataset, number = divmod(seed, MAX_SCENES)
            numbers.setdefault(dataset, []).append(number)
    return [
        {"seed": seed, "scenes": max(found) + 1, "frames": len(found)}
        for seed, found in sorted(numbers.items())
    ]


def usual_pictures(
    sets: Iterable[tuple[FrameCache, Sequence[FrameRecord]]], spec: ModelSpec
) -> dict[str, tuple[float, float]]:
    """The usual range of each statistic of the pictures, over at most 300 frames of each set.

    Args:
        sets: Letterboxed frames, and the same frames as records, for their sizes.
        spec: Input of the model.
    """
    values = spec.depth_encoding
    encoding = None if values is None else DepthEncoding.from_dict(dict(values))
    found = []
    for cache, frames in sets:
        sizes = _sizes_px(cache, frames, spec)
        count = min(_MOST_PICTURES, len(cache))
        for index in (number * len(cache) // count for number in range(count)):
            box = Letterbox.fit(*sizes[index], spec.width, spec.height)
            inner = cache.image(index)[: box.resized_height, : box.resized_width]
            found.append(_statistics(inner, encoding))
    return usual_ranges(found)


def _sizes_px(
    cache: FrameCache, frames: Sequence[FrameRecord], spec: ModelSpec
) -> list[tuple[int, int]]:
    """Width and height of each cached frame; frames that were skipped are passed over."""
    following = iter(frames)
    return [
        next(
            (frame.width, frame.height)
            for frame in following
            if _has_source(frame, spec.modality) and source_path(frame, spec.modality).name == name
        )
        for name in cache.names
    ]


def _has_source(frame: FrameRecord, modality: str) -> bool:
    return modality != "depth" or frame.depth8_path is not None


def _statistics(image: UInt8, encoding: DepthEncoding | None) -> dict[str, float]:
    """The statistics of a stored image; of colour and depth those of both."""
    if image.shape[2:] != (4,):
        return picture_statistics(image, encoding)
    colour, depth = np.ascontiguousarray(image[..., :3]), np.ascontiguousarray(image[..., 3])
    return picture_statistics(colour) | picture_statistics(depth, encoding)
