"""Simulated faults of depth sensors."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from augmentations import STILL

from perceptree.data import Sample, augment
from perceptree.models import ModelSpec, make_spec

WIDTH_PX, HEIGHT_PX = 320, 192
SPEC: ModelSpec = make_spec("edge-n", "depth", HEIGHT_PX, WIDTH_PX)
LEVEL_M = 20 / 255
NONE = 255
FAULTS: dict[str, dict[str, Any]] = {
    "gain": {"depth_gain": 0.1},
    "noise": {"depth_noise": 4.0},
    "far noise": {"far_noise_m": 0.5},
    "steps": {"far_step_m": 2.0},
    "range": {"range_loss": 0.6},
    "shadows": {"stereo_px_m": 60.0},
    "edges": {"edge_loss_px": 4},
    "irregular holes": {"hole_area": 0.3},
    "rectangular holes": {"holes": 6},
}


def scene(post_m: float = 3.0) -> Sample:
    """A wall from 6 to 18 m, one post in front of it, and a patch without readings."""
    image = np.tile(np.linspace(6, 18, HEIGHT_PX)[:, None] / LEVEL_M, (1, WIDTH_PX))
    image[20:170, 150:180] = post_m / LEVEL_M
    image[50:80, 230:280] = NONE
    masks = np.zeros((1, HEIGHT_PX, WIDTH_PX), bool)
    masks[0, 20:170, 150:180] = True
    return Sample(
        np.rint(image).astype(np.uint8),
        np.array([[150.0, 20, 180, 170]]),
        np.zeros((1, 5, 3)),
        masks,
    )


def faulty(seed: int, sample: Sample | None = None, **settings: Any) -> Sample:
    return augment(np.random.default_rng(seed), sample or scene(), SPEC, replace(STILL, **settings))


@pytest.mark.parametrize("name", FAULTS)
def test_missing_readings_and_labels_are_unchanged(name: str) -> None:
    changed = 0
    for seed in range(10):
        before, after = scene(), faulty(seed, **FAULTS[name])
        assert (after.image[before.image == NONE] == NONE).all()
        changed += bool((after.image != before.image).any())
        assert after.masks is not None
        assert (after.boxes == before.boxes).all()
        assert (after.masks == before.masks).all()
    assert changed >= 7


@pytest.mark.parametrize("name", FAULTS)
def test_without_masks_the_same_readings_are_lost(name: str) -> None:
    bare = faulty(3, replace(scene(), masks=None), **FAULTS[name])
    assert bare.masks is None
    assert (bare.image == faulty(3, **FAULTS[name]).image).all()


def test_stereo_noise_grows_with_distance() -> None:
    gaps = []
    for seed in range(12):
        image = faulty(seed, far_noise_m=0.6).image.astype(float)
        gaps.append((image - scene().image)[:, :140] * LEVEL_M)
    near, far = np.std(gaps, axis=(0, 2))[[8, -40]]  # at 6.5 m and 15.5 m
    assert 3.5 < far / near < 8  # (15.5 / 6.5)**2 is 5.7; rounding to levels adds error
    assert abs(np.mean(gaps)) < 0.05


def test_steps_of_disparity_grow_with_distance() -> None:
    image = faulty(2, far_step_m=3.0).image[:, 10].astype(int)
    steps = np.diff(image)
    sizes, rows_px = steps[steps > 0], image[1:][steps > 0]
    near, far = sizes[rows_px < 110].mean(), sizes[rows_px > 160].mean()
    assert far > 2 * near
    # In 1/z all steps are equal.
    inverse = np.unique(image[image < NONE]) * LEVEL_M
    widths = -np.diff(1 / inverse)
    assert np.ptp(widths) < 0.6 * widths.mean()


def test_there_are_no_readings_beyond_the_range() -> None:
    ends = set()
    for seed in range(12):
        image = faulty(seed, range_loss=0.6).image
        wall = image[:, :140]
        read = wall[wall != NONE]
        assert (wall[wall == NONE].size > 0) == bool(read.max() < 229)
        assert (scene().image[:, :140][wall == NONE] >= read.max()).all()
        ends.add(int(read.max()))
    assert len(ends) > 5


def test_a_tree_beyond_the_range_is_removed() -> None:
    counts = set()
    for seed in range(20):
        for sample in (scene(17.0), replace(scene(17.0), masks=None)):
            result = faulty(seed, sample, range_loss=0.4)
            post = result.image[20:170, 150:180]
            assert len(result.boxes) == len(result.keypoints) == (post != NONE).any()
            counts.add(len(result.boxes))
    assert counts == {0, 1}


def test_stereo_occlusion_is_left_of_near_objects() -> None:
    widths = []
    for seed in range(10):
        row = faulty(seed, stereo_px_m=60.0).image[100]
        lost = np.nonzero(row[:200] == NONE)[0]
        widths.append(len(lost))
        if len(lost):
            assert lost[-1] == 149
            assert len(lost) == 150 - lost[0]
        assert (row[150:230] != NONE).all()
    # 60 px m at 3 m and at 12 m: at most 15 px, drawn uniformly.
    assert 8 < max(widths) <= 15
    assert len(set(widths)) > 4


def test_readings_are_lost_on_both_sides_of_edges() -> None:
    lost = np.zeros((HEIGHT_PX, WIDTH_PX))
    for seed in range(20):
        lost += (faulty(seed, edge_loss_px=4).image == NONE) & (scene().image != NONE)
    columns = lost[30:160].sum(0)
    # The patch without readings is not a depth edge.
    assert set(np.nonzero(columns)[0]) == {*range(146, 154), *range(176, 184)}


def test_irregular_holes_cover_up_to_their_share() -> None:
    shares = []
    for seed in range(30):
        image = faulty(seed, hole_area=0.4).image
        shares.append(((image == NONE) & (scene().image != NONE)).mean())
    assert 0.3 < max(shares) < 0.55
    assert 0.1 < np.mean(shares) < 0.25
