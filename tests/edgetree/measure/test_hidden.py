"""Partly visible stems: hidden on one side, with branches in their masks, cut by the border."""

from dataclasses import replace

import numpy as np
import pytest

from edgetree.measure import Failure

LEANS = pytest.mark.parametrize(("lean_deg", "towards_deg"), [(0, 0), (12, 0), (8, 120)])


@pytest.fixture(scope="module")
def stand_of(scene, pole):
    """Scenes by the lean of their stem, each rendered once."""
    stands = {}

    def build(lean_deg, towards_deg):
        if (lean_deg, towards_deg) not in stands:
            stem = pole(0.3, 0.3, 4.0, lean_deg, towards_deg)
            stands[lean_deg, towards_deg] = scene(stem)
        return stands[lean_deg, towards_deg]

    return build


def beside_the_middle(stem):
    """Pixels to the right of the middle (H, W), and fraction of the height from the top (H, 1)."""
    rows = np.flatnonzero(stem.any(1))
    middle = np.zeros(len(stem))
    middle[rows] = [np.flatnonzero(stem[row]).mean() for row in rows]
    columns = np.arange(stem.shape[1])[None]
    share = (np.arange(len(stem))[:, None] - rows[0]) / (rows[-1] - rows[0])
    return columns - middle[:, None], share


@LEANS
@pytest.mark.parametrize("half", ["lower", "upper", "middle"])
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("by", ["something nearer", "leaves on it"])
def test_a_side_hidden_over_half_the_length(stand_of, lean_deg, towards_deg, half, side, by):
    stand = stand_of(lean_deg, towards_deg)
    stem = stand.owner == 1
    right_px, share = beside_the_middle(stem)
    # Only the mask separates leaves at the depth of the stem, so most of the stem must be visible.
    hidden = 0.5 if by == "something nearer" else 0.35
    low = {"lower": 1 - hidden, "upper": -1.0, "middle": (1 - hidden) / 2}[half]
    high = {"lower": 2.0, "upper": hidden, "middle": (1 + hidden) / 2}[half]
    hiding = (share > low) & (share < high) & (side * right_px > 6) & (side * right_px < 60)
    nearer = hiding & (by == "something nearer")
    depth_m = np.where(nearer, np.float32(2.5), stand.depth_m)
    tree = stand.measure_mask(stem & ~hiding, depth_m=depth_m)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.02)
    both = stand.measure(masks=[stem & ~hiding], depth_m=depth_m)
    assert both.diameter_m.value == pytest.approx(0.3, rel=0.01)


@LEANS
@pytest.mark.parametrize("depth", ["behind", "beside"])
def test_a_branch_in_the_mask(stand_of, lean_deg, towards_deg, depth):
    stand = stand_of(lean_deg, towards_deg)
    stem = stand.owner == 1
    right_px, share = beside_the_middle(stem)
    branch = (share > 0.3) & (share < 0.45) & (right_px > 0) & (right_px < 120) & ~stem
    depth_m = np.where(branch & (depth == "beside"), np.float32(4.1), stand.depth_m)
    tree = stand.measure_mask(stem | branch, depth_m=depth_m)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.02)
    coarse = replace(stand.detections([stem | branch]), keypoints_px=None)
    assert stand.measure(coarse, depth_m).diameter_m.value == pytest.approx(0.3, rel=0.02)


def test_a_side_hidden_along_the_whole_stem_is_not_guessed(stand_of):
    stand = stand_of(0, 0)
    stem = stand.owner == 1
    right_px, _ = beside_the_middle(stem)
    hiding = (right_px > 5) & (right_px < 60)
    depth_m = np.where(hiding, np.float32(2.5), stand.depth_m)
    tree = stand.measure_mask(stem & ~hiding, depth_m=depth_m)
    assert tree.diameter_m == Failure(
        "neither the diameter keypoints nor the mask show both edges of the stem"
    )


@pytest.mark.parametrize("column", [-10, 0, 10, 20, 34, 1246, 1260, 1272, 1285])
@pytest.mark.parametrize("how", ["mask", "coarse mask", "keypoints"])
def test_a_stem_at_the_border_fails_or_has_a_large_enough_error(scene, pole, column, how):
    stand = scene(pole(0.3, 4.0 * (column - 640) / 700, 4.0))
    if how == "mask":
        tree = stand.measure_mask(settings=None)
    else:
        trees = stand.detections()
        trees = replace(trees, keypoints_px=None) if how == "coarse mask" else trees
        tree = stand.measure(trees, settings=None)
    if tree.diameter_m:
        low_m, high_m = tree.diameter_m.interval95
        assert low_m < 0.3 < high_m
    else:
        assert tree.diameter_m.reason


def test_the_image_border_is_not_an_edge_of_the_stem(scene, pole):
    stand = scene(pole(0.3, 4.0, 4.375))
    assert stand.measure_mask().diameter_m == Failure(
        "neither the diameter keypoints nor the mask show both edges of the stem"
    )


@pytest.mark.parametrize("gap_px", [4, 6, 8])
@pytest.mark.parametrize("right", [-1, 1])
@pytest.mark.parametrize("share", [0.4, 0.7])
def test_a_coarse_mask_that_ends_before_the_border_has_no_edge_there(
    scene, pole, gap_px, right, share
):
    """The masks of networks end a few pixels before the border that cuts their stem off."""
    radius_px = 0.15 * 700 / 4.0
    inwards_px = (2 * share - 1) * radius_px
    stand = scene(pole(0.3, right * (640 - inwards_px) * 4.0 / 700, 4.0))
    stem = stand.owner == 1
    stem[:, :gap_px] = stem[:, -gap_px:] = False
    trees = replace(stand.detections([stem]), keypoints_px=None)
    tree = stand.measure(trees, settings=None)
    assert not tree.diameter_m or abs(tree.diameter_m.value - 0.3) < 1.96 * tree.diameter_m.std


@pytest.mark.parametrize("gap_px", [14, 26])
@pytest.mark.parametrize("right", [-1, 1])
@pytest.mark.parametrize("share", [0.4, 0.7])
def test_a_mask_has_no_edge_near_a_side_beyond_which_the_edge_keypoint_lies(
    scene, pole, gap_px, right, share
):
    """Keypoints out of the picture get a low score, and a place within it."""
    radius_px = 0.15 * 700 / 4.0
    inwards_px = (2 * share - 1) * radius_px + gap_px / 2
    stand = scene(pole(0.3, right * (640 - inwards_px) * 4.0 / 700, 4.0))
    stem = stand.owner == 1
    stem[:, :gap_px] = stem[:, -gap_px:] = False
    trees = with_edge_keypoint(stand.detections([stem]), right, gap_px, 0.02)
    tree = stand.measure(trees, settings=None)
    assert not tree.diameter_m or abs(tree.diameter_m.value - 0.3) < 1.96 * tree.diameter_m.std


@pytest.mark.parametrize("gap_px", [14, 26])
@pytest.mark.parametrize("right", [-1, 1])
def test_a_whole_stem_near_the_side_is_measured(scene, pole, gap_px, right):
    inwards_px = 0.15 * 700 / 4.0 + gap_px
    stand = scene(pole(0.3, right * (640 - inwards_px) * 4.0 / 700, 4.0))
    trees = with_edge_keypoint(stand.detections([stand.owner == 1]), right, gap_px, 0.4)
    tree = stand.measure(trees, settings=None)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.03)
    assert tree.diameter_m.std < 0.03


def with_edge_keypoint(trees, right, gap_px, score):
    """The detections with the edge keypoint of the stem towards a side at the end of its mask."""
    keypoints = trees.keypoints_px.copy()
    edge_px = gap_px if right < 0 else trees.image_width - gap_px
    keypoints[0, 1 if right < 0 else 2, ::2] = edge_px, score
    return replace(trees, keypoints_px=keypoints)


@pytest.mark.parametrize("diameter_m", [0.15, 0.3, 0.5])
@pytest.mark.parametrize("ahead_m", [2.5, 4.0])
@pytest.mark.parametrize("gap_m", [0.0, 0.1])
def test_two_stems_in_one_mask_are_refused(scene, pole, diameter_m, ahead_m, gap_m):
    right_m = (diameter_m + gap_m) / 2
    stand = scene(pole(diameter_m, -right_m, ahead_m), pole(diameter_m, right_m, ahead_m))
    columns = np.flatnonzero((stand.owner > 0).any(0))
    both = (stand.owner > 0) | (stand.owner == 0)
    both[:, : columns[0]] = both[:, columns[-1] + 1 :] = False
    both &= (stand.owner > 0).any(1)[:, None]
    trees = replace(stand.detections([both, both]).select([0]), keypoints_px=None, masks=None)
    tree = stand.measure(trees, depth_m=stand.noisy_depth_m(1), masks=[both], settings=None)
    assert isinstance(tree.diameter_m, Failure)
    assert "more than one stem" in tree.diameter_m.reason


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("noise_per_m", [0.002, 0.006])
def test_one_noisy_stem_is_not_taken_for_two(scene, pole, seed, noise_per_m):
    rng = np.random.default_rng(seed)
    stem = pole(rng.uniform(0.1, 0.6), 0.3, rng.uniform(1.5, 8), 8.0, 60.0 * seed)
    stand = scene(stem)
    tree = stand.measure_mask(depth_m=stand.noisy_depth_m(seed, noise_per_m), settings=None)
    assert tree.diameter_m.value == pytest.approx(stem.diameter_m, rel=0.12)
