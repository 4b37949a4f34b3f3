"""Trees that were detected twice."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from edgetree.model_file.manifest import Manifest
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.duplicates import distinct_trees
from edgetree.runtime.session import FakeSession

STEM = (100.0, 40.0, 140.0, 340.0)
LOWER_HALF = (102.0, 190.0, 138.0, 340.0)
NEIGHBOUR = (150.0, 40.0, 190.0, 340.0)


def full(count: int) -> NDArray[np.float32]:
    return np.ones((count, 28, 28), np.float32)


def kept(*boxes: tuple[float, ...], masks: NDArray[np.float32] | None = None) -> list[bool]:
    grids = full(len(boxes)) if masks is None else masks
    return [bool(each) for each in distinct_trees(np.array(boxes), grids, 0.8)]


def test_half_a_stem_within_the_whole_is_dropped_though_the_boxes_differ() -> None:
    assert kept(STEM, LOWER_HALF) == [True, False]


def test_the_higher_score_is_kept_though_its_mask_is_smaller() -> None:
    assert kept(LOWER_HALF, STEM) == [True, False]


def test_neighbours_are_kept() -> None:
    assert kept(STEM, NEIGHBOUR) == [True, True]


def test_a_stem_behind_another_is_kept_though_the_boxes_are_the_same() -> None:
    masks = np.zeros((2, 28, 28), np.float32)
    masks[0, :, :14], masks[1, :, 14:] = 1.0, 1.0
    assert kept(STEM, STEM, masks=masks) == [True, True]


def test_what_covers_a_dropped_tree_alone_is_kept() -> None:
    above = (100.0, 40.0, 140.0, 130.0)
    between = (100.0, 40.0, 140.0, 340.0)
    assert kept(LOWER_HALF, between, above) == [True, False, True]


def test_empty_masks_and_no_trees_are_no_duplicates() -> None:
    assert kept(STEM, STEM, masks=np.zeros((2, 28, 28), np.float32)) == [True, True]
    assert distinct_trees(np.zeros((0, 4)), full(0), 0.8).tolist() == []


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.95))
def test_it_is_the_overlap_of_the_drawn_masks(seed: int, most: float) -> None:
    """Held against masks drawn on a fine raster, where the overlap is not near the limit."""
    random = np.random.default_rng(seed)
    low = random.uniform(0, 40, (2, 2))
    boxes = np.concatenate([low, low + random.uniform(20, 60, (2, 2))], 1)
    masks = full(2) * 0
    for mask in masks:
        top, left = random.integers(0, 14, 2)
        mask[top : top + 14, left : left + 14] = 1.0
    drawn = [drawn_mask(box, mask) for box, mask in zip(boxes, masks, strict=True)]
    share = (drawn[0] & drawn[1]).sum() / min(each.sum() for each in drawn)
    if abs(share - most) > 0.1:
        assert distinct_trees(boxes, masks, most).tolist() == [True, bool(share <= most)]


def drawn_mask(box: NDArray[np.float64], mask: NDArray[np.float32]) -> NDArray[np.bool_]:
    x = y = (np.arange(1000) + 0.5) / 10
    column = np.floor((x - box[0]) / (box[2] - box[0]) * 28).astype(int)
    row = np.floor((y - box[1]) / (box[3] - box[1]) * 28).astype(int)
    inside = ((row >= 0) & (row < 28))[:, None] & ((column >= 0) & (column < 28))
    there = mask[np.clip(row, 0, 27)][:, np.clip(column, 0, 27)] > 0.5
    return np.asarray(inside & there)


@pytest.mark.parametrize(("score_threshold", "left"), [(0.01, 1), (0.95, 0)])
def test_the_detector_leaves_them_out(
    rgb_manifest: Manifest, score_threshold: float, left: int
) -> None:
    boxes = np.array([STEM, LOWER_HALF], np.float32)
    scores = np.array([0.9, 0.8], np.float32)
    keypoints = np.zeros((2, 5, 3), np.float32)
    session = FakeSession.with_trees(
        rgb_manifest, boxes=boxes, scores=scores, keypoints=keypoints, masks=full(2)
    )
    image = np.zeros((384, 640, 3), np.uint8)
    trees = TreeDetector(session, score_threshold=score_threshold).detect(image)
    assert trees.scores.tolist() == pytest.approx([0.9][:left])
