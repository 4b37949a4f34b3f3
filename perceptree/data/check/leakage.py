"""Leakage: images or scenes that are in two splits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.data.check.pictures import SIGNATURE_WORDS, Signature
from perceptree.data.coco import FrameRecord

# Of 512 bits. In 1,180 simulated frames, different ones differ by 250 bits (median) and at least 57
# (two in thick fog). Compression to JPEG quality 30, scaling, brightening or noise change up to 30.
SAME_PICTURE_BITS = 40
_PAIRS_AT_ONCE = 1_000_000


def scene_of(frame: FrameRecord) -> int | str | None:
    """Return the seed of the frame's scene, None if the dataset does not give it."""
    scene = frame.extra.get("scene")
    seed = scene.get("seed") if isinstance(scene, dict) else None
    return seed if isinstance(seed, int | str) else None


def file_leaks(splits: Mapping[str, Sequence[FrameRecord]]) -> Iterator[str]:
    """Yield descriptions of image files that are in two splits."""
    paths = {
        split: {str(frame.image_path): frame for frame in frames}
        for split, frames in splits.items()
    }
    for first, second in combinations(paths, 2):
        for path in paths[first]:
            if path in paths[second]:
                yield f"{paths[first][path].image_path.name} in {first} and {second}"


def scene_leaks(splits: Mapping[str, Sequence[FrameRecord]]) -> Iterator[str]:
    """Yield descriptions of scenes that are in two splits; every frame must name its scene."""
    scenes: dict[str, dict[Any, FrameRecord]] = {}
    for split, frames in splits.items():
        known = scenes.setdefault(split, {})
        for frame in frames:
            known.setdefault(scene_of(frame), frame)
    for first, second in combinations(scenes, 2):
        for scene, frame in scenes[first].items():
            other = scenes[second].get(scene)
            if other is not None:
                yield (
                    f"scene {scene} in {first} ({frame.image_path.name})"
                    f" and {second} ({other.image_path.name})"
                )


def picture_leaks(
    splits: Mapping[str, Sequence[FrameRecord]],
    signatures: Mapping[str, Sequence[Signature | None]],
) -> Iterator[str]:
    """Yield descriptions of images nearly identical to one of an earlier split.

    Args:
        splits: Frames of each split.
        signatures: Signature of each frame's image, None if it could not be read.
    """
    readable = {
        split: [
            (frame, bits)
            for frame, bits in zip(frames, signatures[split], strict=True)
            if bits is not None
        ]
        for split, frames in splits.items()
    }
    for first, second in combinations(readable, 2):
        one, other = (_stacked(readable[split]) for split in (first, second))
        for row, nearest in _nearest(one, other):
            yield (
                f"{readable[second][row][0].image_path.name} of {second} is like"
                f" {readable[first][nearest][0].image_path.name} of {first}"
            )


def near_pairs(signatures: Sequence[Signature]) -> Iterator[tuple[int, int]]:
    """Yield (earlier place, later place) of all nearly identical images of one list."""
    stacked = np.array(signatures, np.uint64).reshape(-1, SIGNATURE_WORDS)
    for start, differing in _differing_bits(stacked, stacked):
        later, earlier = np.nonzero(differing <= SAME_PICTURE_BITS)
        for one, other in zip(earlier.tolist(), (later + start).tolist(), strict=True):
            if one < other:
                yield one, other


def _stacked(found: Sequence[tuple[FrameRecord, Signature]]) -> NDArray[np.uint64]:
    return np.array([bits for _, bits in found], np.uint64).reshape(-1, SIGNATURE_WORDS)


def _nearest(one: NDArray[np.uint64], other: NDArray[np.uint64]) -> Iterator[tuple[int, int]]:
    """Yield (row of `other`, nearest row of `one`) where they differ by few bits."""
    if not len(one):
        return
    for start, differing in _differing_bits(one, other):
        nearest = differing.argmin(1)
        bits = differing[np.arange(len(nearest)), nearest]
        for row in np.flatnonzero(bits <= SAME_PICTURE_BITS):
            yield start + int(row), int(nearest[row])


def _differing_bits(
    one: NDArray[np.uint64], other: NDArray[np.uint64]
) -> Iterator[tuple[int, NDArray[np.uint16]]]:
    """Yield (first row of `other`, bits that differ between some of its rows and all of `one`)."""
    step = max(1, _PAIRS_AT_ONCE // max(1, len(one)))
    for start in range(0, len(other), step):
        differing = np.zeros((len(other[start : start + step]), len(one)), np.uint16)
        for word in range(SIGNATURE_WORDS):
            differing += np.bitwise_count(other[start : start + step, word, None] ^ one[:, word])
        yield start, differing
