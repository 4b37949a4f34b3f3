"""Frames of colour and depth: moved together, changed each its own, and one of them left out."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from augmentations import STILL

from basetree.errors import SettingsError
from perceptree.data import AugmentSettings, Sample, augment
from perceptree.models import make_spec

HEIGHT, WIDTH = 64, 128
SPEC = make_spec("edge-n", "both", HEIGHT, WIDTH)
POST = (slice(10, 60), slice(30, 42))


def frame() -> Sample:
    """A post of colour 200 in front of 60, at level 40 in front of 120."""
    image = np.full((HEIGHT, WIDTH, 4), (60, 60, 60, 120), np.uint8)
    image[POST] = 200, 200, 200, 40
    mask = np.zeros((1, HEIGHT, WIDTH), bool)
    mask[0][POST] = True
    keypoints = np.zeros((1, 5, 3))
    keypoints[0, :4] = (36, 58, 2), (30, 54, 2), (42, 54, 2), (36, 40, 2)
    return Sample(image, np.array([[30.0, 10, 42, 60]]), keypoints, mask)


def drawn(seed: int = 0, **changes: Any) -> Sample:
    return augment(np.random.default_rng(seed), frame(), SPEC, replace(STILL, **changes))


def columns(post: Any) -> tuple[int, int]:
    """First and last column of (H, W) pixels."""
    found = np.flatnonzero(post.any(0))
    return int(found[0]), int(found[-1])


def test_nothing_changes_without_settings() -> None:
    np.testing.assert_array_equal(drawn().image, frame().image)


def test_both_move_together_and_are_padded_each_its_own() -> None:
    for seed in range(5):
        found = drawn(seed, flip_share=0.5, scale=(0.6, 0.6), misaligned_share=0)
        x0, _, x1, _ = found.boxes[0]
        colour, depth = found.image[..., 1], found.image[..., 3]
        for post in (colour > 130, depth < 80):
            first, last = columns(post)
            assert (first, last + 1) == pytest.approx((x0, x1), abs=2)
        outside = depth == 255
        assert outside.mean() == pytest.approx(1 - 0.36, abs=0.03)
        assert (colour[outside] == SPEC.colour_pad_value).all()


def test_colours_and_readings_change_each_their_own() -> None:
    brighter = drawn(brightness=0.5)
    assert (brighter.image[..., :3] != frame().image[..., :3]).any()
    np.testing.assert_array_equal(brighter.image[..., 3], frame().image[..., 3])
    noisy = drawn(depth_noise=3.0)
    assert (noisy.image[..., 3] != frame().image[..., 3]).any()
    np.testing.assert_array_equal(noisy.image[..., :3], frame().image[..., :3])


def test_colour_is_moved_against_depth_and_labels() -> None:
    moves = []
    for seed in range(40):
        found = drawn(seed, misaligned_share=1, misaligned_px=4.0)
        np.testing.assert_array_equal(found.image[..., 3], frame().image[..., 3])
        np.testing.assert_array_equal(found.boxes, frame().boxes)
        moves.append(columns(found.image[..., 1] > 130)[0] - 30)
    assert -4 <= min(moves) < -1
    assert 1 < max(moves) <= 4


def test_one_of_the_two_is_left_out_as_often_as_asked() -> None:
    changes = {"without_colour_share": 0.3, "without_depth_share": 0.2}
    found = [drawn(seed, **changes).image for seed in range(300)]
    without_colour = [not image[..., :3].any() for image in found]
    without_depth = [bool((image[..., 3] == 255).all()) for image in found]
    assert np.mean(without_colour) == pytest.approx(0.3, abs=0.08)
    assert np.mean(without_depth) == pytest.approx(0.2, abs=0.08)
    assert not np.logical_and(without_colour, without_depth).any()


def test_a_tree_without_readings_stays_where_the_colour_shows_it() -> None:
    lost = {"range_loss": 0.9, "holes": 0}
    kept = [len(drawn(seed, **lost).boxes) for seed in range(20)]
    assert kept == [1] * 20
    without_colour = [len(drawn(seed, without_colour_share=1, **lost).boxes) for seed in range(20)]
    assert 0 in without_colour


def test_a_pasted_tree_is_pasted_into_both() -> None:
    other = frame()
    other.image[...] = np.roll(other.image, 50, axis=1)
    assert other.masks is not None
    moved = replace(
        other,
        masks=np.roll(other.masks, 50, axis=2),
        boxes=other.boxes + np.array([50, 0, 50, 0]),
        keypoints=other.keypoints + np.array([50, 0, 0]),
    )
    settings = replace(STILL, copy_paste_share=1)
    found = augment(np.random.default_rng(3), frame(), SPEC, settings, lambda: moved)
    assert len(found.boxes) == 2
    assert found.masks is not None
    assert (found.image[found.masks.any(0)] == (200, 200, 200, 40)).all()


def test_more_than_all_frames_cannot_be_without_one_of_the_two() -> None:
    with pytest.raises(SettingsError, match=r"together 1\.2: expected at most 1"):
        AugmentSettings(without_colour_share=0.7, without_depth_share=0.5)
