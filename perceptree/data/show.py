"""Draw pages of frames with their labels."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from basetree.counts import counted
from perceptree.data.coco import FrameRecord
from perceptree.data.dataset import Dataset
from perceptree.data.dividing import check_seed
from perceptree.data.frames import read_frame
from perceptree.drawing import PAPER, Picture, draw_trees, grid, keypoint_legend, with_caption
from perceptree.keypoints import KEYPOINT_NAMES

_CELL_PX = (480, 360)


def choose_frames(
    datasets: Sequence[Dataset], count: int, seed: int
) -> list[tuple[str, FrameRecord]]:
    """Choose frames at random, from the splits in turn.

    Args:
        datasets: The splits.
        count: Largest number of frames.
        seed: Seed of the choice.

    Returns:
        (split, frame) of each chosen frame.

    Raises:
        SettingsError: The seed is below 0.
    """
    check_seed(seed)
    rng = np.random.default_rng(seed)
    drawn = [rng.permutation(len(dataset.frames))[:count] for dataset in datasets]
    turns = [
        (turn, split, int(frames[turn]))
        for split, frames in enumerate(drawn)
        for turn in range(len(frames))
    ]
    chosen = sorted((split, frame) for _, split, frame in sorted(turns)[:count])
    return [
        (datasets[split].labels.split, datasets[split].frames[frame]) for split, frame in chosen
    ]


def labelled_pages(chosen: Sequence[tuple[str, FrameRecord]], per_page: int) -> Iterator[Picture]:
    """Draw pages of frames with boxes, mask outlines and keypoints.

    Args:
        chosen: (split, frame) from `choose_frames`.
        per_page: Number of frames on a page.

    Yields:
        Pages (H, W, 3) BGR uint8.

    Raises:
        DatasetError: If an image cannot be read.
    """
    for first in range(0, len(chosen), per_page):
        cells = [_cell(split, frame) for split, frame in chosen[first : first + per_page]]
        page = grid(cells, math.ceil(math.sqrt(len(cells))))
        yield np.concatenate([keypoint_legend(KEYPOINT_NAMES, page.shape[1]), page])


def _cell(split: str, frame: FrameRecord) -> Picture:
    """Draw a frame with its labels at a cell's size, with a caption below."""
    width, height = _CELL_PX
    scale = min(width / frame.width, height / frame.height)
    trees = frame.trees
    drawn = draw_trees(
        read_frame(frame, "rgb"),
        boxes=np.array([tree.box_px for tree in trees]).reshape(-1, 4),
        masks=(None if tree.segmentation is None else frame.mask(tree) for tree in trees),
        keypoints=np.array([tree.keypoints for tree in trees]).reshape(-1, 5, 3),
        width_px=max(1, round(scale * frame.width)),
    )
    left = (width - drawn.shape[1]) // 2
    cell = np.full((drawn.shape[0], width, 3), PAPER, np.uint8)
    cell[:, left : left + drawn.shape[1]] = drawn
    ignored = sum(tree.ignored for tree in trees)
    counts = counted(len(trees) - ignored, "tree") + (f", {ignored} ignored" if ignored else "")
    return with_caption(cell, f"{split}  {frame.image_path.name}  {counts}")
