"""Trees that a depth image still shows after its faults."""

from __future__ import annotations

from dataclasses import replace

from basetree.arrays import UInt8
from calib import DepthEncoding
from perceptree.data.augment.depth import trees_still_read
from perceptree.data.frames import Sample


def with_readings(sample: Sample, image: UInt8, dense: UInt8, encoding: DepthEncoding) -> Sample:
    """Give a sample of depth the image, and remove the trees that `dense` no longer shows.

    Args:
        sample: The sample, with the depth before the faults.
        image: (H, W) uint8 depth of the result.
        dense: (H, W) uint8 depth in which trees are looked for.
        encoding: Encoding of the depth.
    """
    invalid = encoding.invalid_value
    kept = trees_still_read(sample.image, dense, invalid, sample.boxes, sample.masks)
    sample = replace(sample, image=image)
    return sample if len(kept) == len(sample.boxes) else _select_trees(sample, kept)


def _select_trees(sample: Sample, kept: list[int]) -> Sample:
    masks = None if sample.masks is None else sample.masks[kept]
    boxes, keypoints = sample.boxes[kept], sample.keypoints[kept]
    return replace(sample, boxes=boxes, keypoints=keypoints, masks=masks)
