"""Read frames of a simulated dataset as sample frames, with camera and ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from basetree.errors import InputError
from calib import PinholeCamera
from edgetree.samples import SampleFrame, SampleTree

if TYPE_CHECKING:
    from perceptree.data import FrameRecord, TreeRecord


def held_out_frames(data: Path, split: str, count: int) -> list[SampleFrame]:
    """Read up to `count` frames of a simulated dataset, spread evenly over a split.

    Args:
        data: Folder of the dataset.
        split: "train", "val" or "test".
        count: Number of frames.

    Raises:
        perceptree.errors.DatasetError: The split is missing or broken.
        InputError: a frame lacks the depth, camera or ground truth that the simulator writes.
    """
    from perceptree.data import read_split

    records = read_split(data, split)
    picked = np.linspace(0, len(records) - 1, min(count, len(records))).round().astype(int)
    try:
        return [_sample_frame(records[index]) for index in picked]
    except KeyError as error:
        raise InputError(
            f"split {split} of {data} has no {error}: expected a dataset of the simulator"
        ) from error


def _sample_frame(record: FrameRecord) -> SampleFrame:
    if record.depth_path is None:
        raise KeyError("depth_file")
    return SampleFrame(
        name=record.image_path.stem,
        image_path=record.image_path,
        depth_path=record.depth_path,
        camera=PinholeCamera.from_dict(record.extra["camera"]),
        up_camera=np.array(record.extra["up_camera"], dtype=np.float64),
        trees=tuple(_sample_tree(tree) for tree in record.trees),
    )


def _sample_tree(record: TreeRecord) -> SampleTree:
    species = record.species or "unknown"
    own = {"box_px": record.box_px, "keypoints_px": record.keypoints, "species": species}
    return SampleTree.from_dict({**record.truth, **own})
