"""Pasted trees: occlusion in image and labels."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from augmentations import STILL

from perceptree.data import Sample, augment
from perceptree.models import ModelSpec, make_spec

WIDTH_PX, HEIGHT_PX = 160, 96
NONE = 255
PASTING = replace(STILL, copy_paste_share=1.0)


def spec_of(modality: Any) -> ModelSpec:
    return make_spec("edge-n", modality, HEIGHT_PX, WIDTH_PX)


def post(x0: int, x1: int, level: int, modality: str, back: int = 150) -> Sample:
    """One post, the same after a flip, from row 10 to 90 over an even background."""
    image = np.full((HEIGHT_PX, WIDTH_PX), back, np.uint8)
    masks = np.zeros((1, HEIGHT_PX, WIDTH_PX), bool)
    masks[0, 10:90, x0:x1] = True
    image[masks[0]] = level
    if modality == "rgb":
        image = np.repeat(image[..., None], 3, 2)
    middle = (x0 + x1) / 2
    points = [[middle, 80, 2], [x0, 75, 2], [x1, 75, 2], [middle, 50, 2], [middle, 30, 1]]
    return Sample(image, np.array([[x0, 10.0, x1, 90]]), np.array([points]), masks)


def pasted(sample: Sample, other: Sample, modality: Any, **settings: Any) -> Sample:
    changed = replace(PASTING, **settings)
    rng = np.random.default_rng(0)
    return augment(rng, sample, spec_of(modality), changed, lambda: other)


def test_in_depth_the_nearer_tree_occludes_the_farther() -> None:
    near, far = post(60, 90, 40, "depth"), post(70, 100, 90, "depth")
    for sample, other in ((near, far), (far, near)):
        result = pasted(sample, other, "depth")
        assert result.masks is not None
        assert len(result.boxes) == 2
        depths = [result.image[mask] for mask in result.masks]
        assert sorted({int(level) for depth in depths for level in depth}) == [40, 90]
        for mask, depth in zip(result.masks, depths, strict=True):
            assert len(set(depth.tolist())) == 1  # a mask holds one tree's pixels
            if depth[0] == 40:
                assert mask.sum() == 30 * 80  # the near one is whole
            else:
                assert mask.sum() < 30 * 80
        assert not (result.masks[0] & result.masks[1]).any()
        assert (result.image == 150).sum() == HEIGHT_PX * WIDTH_PX - result.masks.sum()
        for box, mask in zip(result.boxes, result.masks, strict=True):
            columns = np.nonzero(mask.any(0))[0]
            assert box[[0, 2]].tolist() == [columns[0], columns[-1] + 1]


def test_occluded_keypoints_are_flagged_and_mostly_occluded_trees_removed() -> None:
    behind = post(60, 100, 90, "depth")
    # Symmetric about the middle, so that mirroring makes no difference.
    result = pasted(behind, post(70, 90, 40, "depth"), "depth")
    assert len(result.boxes) == 2
    # Cut and middle are behind the new post, left and right are not; the last was hidden before.
    assert result.keypoints[0, :, 2].tolist() == [1, 2, 2, 1, 1]
    assert result.keypoints[1, :, 2].tolist() == [2, 2, 2, 2, 1]
    assert (result.keypoints[0, :, :2] == behind.keypoints[0, :, :2]).all()

    wide = pasted(behind, post(63, 97, 40, "depth"), "depth")
    assert len(wide.boxes) == 1
    assert wide.image[50, 80] == 40

    # Behind the frame's own tree, too few of its columns are visible for a label.
    unseen = pasted(post(63, 97, 40, "depth"), behind, "depth")
    assert len(unseen.boxes) == 1
    assert (unseen.image == post(63, 97, 40, "depth").image).all()

    half = pasted(post(70, 90, 40, "depth"), behind, "depth")
    assert half.keypoints[1, :, 2].tolist() == [1, 2, 2, 1, 1]


def test_missing_readings_are_pasted_at_the_trees_distance() -> None:
    other = post(70, 90, 40, "depth")
    other.image[40:50, 70:90] = NONE
    result = pasted(post(0, 10, 90, "depth"), other, "depth")
    assert (result.image[40:50, 70:90] == NONE).all()
    assert result.masks is not None
    assert (result.masks[1] == other.masks).all()
    # Behind a nearer background nothing is visible, not even missing readings.
    near = pasted(post(0, 10, 20, "depth", back=30), other, "depth")
    assert len(near.boxes) == 1
    assert (near.image != NONE).all()


def test_colours_are_pasted_on_top_with_soft_edges() -> None:
    result = pasted(post(10, 30, 60, "rgb"), post(70, 90, 250, "rgb"), "rgb")
    assert len(result.boxes) == 2
    assert (result.image[20:80, 72:88] == 250).all()
    assert 200 < result.image[50, 70, 0] < 250  # two thirds of the way from 150
    assert (result.image[50, 10:30] == 60).all()


@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_one_to_three_trees_come_from_the_other_frame(modality: Any) -> None:
    single = [post(x, x + 12, 40 + x // 2, modality) for x in range(8, 148, 24)]
    image = np.min([one.image for one in single], axis=0)
    parts = [
        np.concatenate([getattr(one, name) for one in single])
        for name in ("boxes", "keypoints", "masks")
    ]
    other, counts = Sample(image, *parts), set()
    empty = Sample(np.full_like(image, 200), parts[0][:0], parts[1][:0], parts[2][:0])
    for seed in range(20):
        rng = np.random.default_rng(seed)
        result = augment(rng, empty, spec_of(modality), PASTING, lambda: other)
        assert len(result.boxes) == len(result.keypoints)
        assert (result.keypoints[:, 1, 0] < result.keypoints[:, 2, 0]).all()
        counts.add(len(result.boxes))
    assert counts == {1, 2, 3}
    assert (other.image == image).all()


def test_trees_keep_their_position_or_are_mirrored() -> None:
    lefts = set()
    for seed in range(20):
        rng = np.random.default_rng(seed)
        sample, other = post(70, 90, 60, "depth"), post(10, 30, 40, "depth")
        result = augment(rng, sample, spec_of("depth"), PASTING, lambda other=other: other)
        lefts.add(float(result.boxes[1, 0]))
    assert lefts == {10, WIDTH_PX - 30}


def test_nothing_is_pasted_without_masks_or_another_frame() -> None:
    sample, other = post(10, 30, 60, "depth"), post(70, 90, 40, "depth")
    bare = replace(sample, masks=None)
    assert len(pasted(bare, other, "depth").boxes) == 1
    assert len(pasted(sample, replace(other, masks=None), "depth").boxes) == 1
    alone = augment(np.random.default_rng(0), sample, spec_of("depth"), PASTING)
    assert len(alone.boxes) == 1


def test_another_frame_is_read_only_when_needed() -> None:
    sample, asked = post(10, 30, 60, "depth"), []

    def other() -> Sample:
        asked.append(1)
        return post(70, 90, 40, "depth")

    settings = replace(PASTING, copy_paste_share=0.3)
    for seed in range(100):
        augment(np.random.default_rng(seed), sample, spec_of("depth"), settings, other)
    assert 15 < len(asked) < 45
