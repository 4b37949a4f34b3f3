"""Augmentation: image and labels change together."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from augmentations import STILL

from perceptree.data import AugmentSettings, FrameStore, Sample, augment, flip, read_split
from perceptree.models import make_spec


def store_of(posts: Path, modality: Any) -> FrameStore:
    return FrameStore(read_split(posts, "train"), make_spec("edge-n", modality, 96, 160))


def test_a_flip_mirrors_everything_and_swaps_left_and_right(posts: Path) -> None:
    sample = store_of(posts, "depth")[1]
    mirrored = flip(sample)
    assert (mirrored.image == sample.image[:, ::-1]).all()
    for row in range(2):
        x0, y0, x1, y1 = sample.boxes[row]
        assert mirrored.boxes[row].tolist() == [160 - x1, y0, 160 - x0, y1]
        assert (mirrored.masks[row] == sample.masks[row][:, ::-1]).all()
        # The left keypoint is still on the left: the two were swapped.
        left, right = mirrored.keypoints[row, 1], mirrored.keypoints[row, 2]
        assert left[0] < right[0]
        assert left.tolist() == [160 - sample.keypoints[row, 2, 0], *sample.keypoints[row, 2, 1:]]
        assert mirrored.keypoints[row, 4].tolist() == [0, 0, 0]
    again = flip(mirrored)
    assert (again.keypoints == sample.keypoints).all()
    assert (again.boxes == sample.boxes).all()


def test_the_source_frame_is_not_changed(posts: Path) -> None:
    store = store_of(posts, "rgb")
    before = store[1]
    kept = Sample(*(np.copy(getattr(before, name)) for name in vars(before)))
    for seed in range(5):
        augment(np.random.default_rng(seed), store[1], store.spec, AugmentSettings())
    for name, value in vars(kept).items():
        assert (getattr(store[1], name) == value).all()


@pytest.mark.parametrize("scale", [0.6, 1.5])
def test_scaling_and_shifting_keep_labels_on_the_picture(posts: Path, scale: float) -> None:
    store = store_of(posts, "depth")
    settings = replace(STILL, flip_share=0.5, scale=(scale, scale))
    gaps_px: list[float] = []
    for seed in range(40):
        sample = augment(np.random.default_rng(seed), store[1], store.spec, settings)
        post = sample.image < 108  # a post at 5 m is grey 64, what is behind it 153
        labelled = sample.masks.any(0)
        # The posts' edges are inside a pixel, which belongs to one side or the other.
        assert (labelled & ~post).mean() < 0.015
        if len(sample.masks) == 2:  # a post that is nearly all cut away is not labelled
            assert (post & ~labelled).mean() < 0.015
        for box, mask, points in zip(sample.boxes, sample.masks, sample.keypoints, strict=True):
            columns, rows = np.nonzero(mask.any(0))[0], np.nonzero(mask.any(1))[0]
            assert box.tolist() == [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
            left, right = points[1], points[2]
            if left[2] and right[2]:
                gaps_px += [left[0] - box[0], right[0] - box[2]]
            outside = (points[:, :2] < 0).any(1) | (points[:, :2] > (160, 96)).any(1)
            assert not points[outside].any()
    assert len(gaps_px) > 40
    assert np.abs(gaps_px).max() < 1.5
    # Rounding to pixels averages out; a systematic sub-pixel shift would not.
    assert abs(np.mean(gaps_px)) < 0.1


def test_without_changes_the_sample_is_the_same(posts: Path) -> None:
    for modality in ("rgb", "depth"):
        store = store_of(posts, modality)
        sample = augment(np.random.default_rng(0), store[1], store.spec, STILL)
        for name, value in vars(store[1]).items():
            assert np.array_equal(getattr(sample, name), value)


def test_the_result_depends_on_the_generator_alone(posts: Path) -> None:
    for modality in ("rgb", "depth"):
        store = store_of(posts, modality)
        first, second, other = (
            augment(np.random.default_rng(seed), store[1], store.spec, AugmentSettings())
            for seed in (3, 3, 4)
        )
        assert (first.image == second.image).all()
        assert (first.keypoints == second.keypoints).all()
        assert (first.image != other.image).any()


def test_missing_readings_stay_missing(posts: Path) -> None:
    store = store_of(posts, "depth")
    sample = store[1]
    image = sample.image.copy()
    image[20:40, 20:40] = 255
    settings = replace(STILL, depth_gain=0.02, depth_noise=2.0)
    holed = Sample(image, sample.boxes, sample.keypoints, sample.masks)
    changed = augment(np.random.default_rng(1), holed, store.spec, settings).image
    assert (changed[20:40, 20:40] == 255).all()
    gap = np.abs(changed.astype(int) - image)[:90]
    assert gap.max() > 0
    assert np.percentile(gap, 99) < 12
