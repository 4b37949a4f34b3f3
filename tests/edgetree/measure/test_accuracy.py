"""Accuracy on synthetic cylinders: exact input, noise, and hidden parts."""

from dataclasses import replace

import numpy as np
import pytest

from calib import PinholeCamera, pixels_to_rays, project_points
from edgetree.measure import measure_trees


@pytest.mark.parametrize("diameter_m", [0.08, 0.3, 0.8])
@pytest.mark.parametrize(("right_m", "ahead_m"), [(0.0, 1.6), (1.0, 2.0), (-1.5, 4.0), (4.0, 9.0)])
def test_upright_stems_anywhere_in_the_picture(scene, pole, diameter_m, right_m, ahead_m):
    stand = scene(
        pole(diameter_m, right_m, ahead_m), camera_height_m=1.2, pitch_deg=20.0, roll_deg=3.0
    )
    tree = stand.measure()
    truth = np.linalg.norm(stand.axis_point(stand.poles[0], 0.25))
    assert tree.diameter_m.value == pytest.approx(diameter_m, rel=0.005)
    assert tree.distance_m.value == pytest.approx(truth, rel=0.003)
    assert tree.cut_height_m.value == pytest.approx(0.25, abs=0.01)
    assert tree.inclination_deg.value == pytest.approx(0.0, abs=0.3)
    assert tree.cut_point_m.xyz_m == pytest.approx(stand.cut_point(stand.poles[0]), abs=0.012)


@pytest.mark.parametrize("lean_deg", [10.0, 20.0, 30.0])
@pytest.mark.parametrize("towards_deg", [0.0, 90.0, 180.0, 270.0, 315.0])
def test_leaning_stems_are_measured_across_their_axis(scene, pole, lean_deg, towards_deg):
    stand = scene(pole(0.35, -0.8, 4.0, lean_deg, towards_deg), slope_deg=8.0)
    tree = stand.measure()
    assert tree.diameter_m.value == pytest.approx(0.35, rel=0.005)
    assert tree.inclination_deg.value == pytest.approx(lean_deg, abs=0.5)
    assert tree.cut_height_m.value == pytest.approx(stand.cut_height_m(stand.poles[0]), abs=0.01)


@pytest.mark.parametrize("slope_deg", [10.0, 20.0, 30.0])
@pytest.mark.parametrize(("uphill_deg", "pitch_deg"), [(0.0, 8.0), (90.0, 0.0), (200.0, 14.0)])
def test_cut_heights_count_from_the_uphill_side(scene, pole, slope_deg, uphill_deg, pitch_deg):
    stem = pole(0.5, 0.4, 4.0, cut_m=0.4, section_m=0.6)
    stand = scene(stem, slope_deg=slope_deg, uphill_deg=uphill_deg, pitch_deg=pitch_deg)
    tree = stand.measure()
    expected = 0.4 - 0.25 * np.tan(np.radians(slope_deg))
    assert tree.cut_height_m.value == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(
    ("right_m", "ahead_m", "least_bias"), [(0.0, 1.6, 0.07), (0.0, 3.0, 0.035), (3.6, 4.5, 0.08)]
)
def test_the_exact_formula_beats_the_pixel_formula(scene, pole, right_m, ahead_m, least_bias):
    stand = scene(pole(0.3, right_m, ahead_m), camera_height_m=0.8, pitch_deg=0.0)
    left, right = stand.detections().keypoints_px[0, 1:3, :2]
    middle = (left + right) / 2
    depth_m = stand.depth_m[int(middle[1]), int(middle[0])]
    naive_m = depth_m * (right[0] - left[0]) / stand.camera.fx
    assert abs(naive_m / 0.3 - 1) > least_bias
    assert stand.measure().diameter_m.value == pytest.approx(0.3, rel=0.005)


def test_lens_distortion_is_corrected(scene, pole):
    bent = PinholeCamera(1280, 720, 700.0, 690.0, 650.0, 350.0, (-0.12, 0.05, 0.001, -0.002, 0.0))
    tree = scene(pole(0.3, 2.0, 3.5), camera=bent).measure()
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.005)
    assert tree.cut_height_m.value == pytest.approx(0.25, abs=0.01)


def test_the_vertical_is_estimated_where_none_is_given(scene, pole):
    stand = scene(pole(0.3, 0.3, 4.0), pitch_deg=15.0, roll_deg=4.0)
    tree = stand.measure(level=True)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.005)
    assert tree.cut_height_m.value == pytest.approx(0.25, abs=0.02)
    low_deg, high_deg = tree.inclination_deg.interval95
    assert low_deg < 0.0 < high_deg


def test_without_masks_the_edges_bound_the_stem(scene, pole):
    stand = scene(pole(0.3, 0.3, 4.0))
    bare = replace(stand.detections(), masks=None)
    assert stand.measure(bare).diameter_m.value == pytest.approx(0.3, rel=0.005)


def test_a_distance_without_keypoints_carries_no_keypoints_error(scene, pole):
    stand = scene(pole(0.3, 0.0, 4.0), pitch_deg=0.0)
    tree = stand.measure_mask(settings=None)
    rows = np.flatnonzero((stand.owner == 1).any(1))
    true_m = 4.0 * np.hypot(1.0, (rows[-1] + 0.5 - 359.5) / 700.0 * (1 - 0.15 / 4.0))
    assert tree.distance_m.value == pytest.approx(true_m, abs=2 * tree.distance_m.std)
    assert tree.distance_m.std < 0.04
    assert tree.evidence.distance_at == "lowest seen part of the stem"
    assert stand.measure(settings=None).evidence.distance_at == "felling cut"


def test_a_section_hidden_by_grass_is_measured_from_the_stem_above(scene, pole):
    leaning = pole(0.3, 0.3, 4.0, 8.0, 270.0)
    stand = scene(leaning)
    stem = stand.owner == 1
    grass = np.zeros_like(stem)
    hidden_to = int(project_points(stand.camera, stand.axis_point(leaning, 2.0))[1])
    grass[hidden_to:, 480:800] = True
    depth_m = np.where(grass & stem, 3.0, stand.depth_m).astype(np.float32)
    tree = stand.measure(stand.detections([stem & ~grass]), depth_m)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.015)
    assert tree.cut_height_m.value == pytest.approx(0.25, abs=0.02)
    assert tree.distance_m.std > 2 * stand.measure().distance_m.std


def test_objects_in_front_of_a_stem_are_excluded_by_its_mask(scene, pole):
    stand = scene(pole(0.3, 0.3, 4.0))
    stem = stand.owner == 1
    heights = [stand.axis_point(stand.poles[0], height_m) for height_m in (2.8, 0.6)]
    top, bottom = project_points(stand.camera, heights)[:, 1].astype(int)
    crossing = np.zeros_like(stem)
    crossing[top:bottom] = True
    depth_m = np.where(crossing, np.minimum(stand.depth_m, 3.2), stand.depth_m)
    tree = stand.measure(stand.detections([stem & ~crossing]), depth_m)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.01)


def test_readings_on_the_stem_are_not_ground(scene, pole):
    """Where little ground is visible, most depth samples are on the stem."""
    stand = scene(pole(0.6, 0.0, 3.0))
    shown = np.random.default_rng(0).random(stand.owner.shape) < 0.05
    depth_m = np.where(shown | (stand.owner == 1), stand.depth_m, 0).astype(np.float32)
    assert stand.measure(depth_m=depth_m).cut_height_m.value == pytest.approx(0.25, abs=0.01)


def test_many_stems_in_sparse_depth_before_one_large_mask(scene, pole):
    """Their samples of the ground are more than OpenCV looks up in one row."""
    stand = scene(pole(0.6, 0.0, 3.0))
    shown = np.random.default_rng(0).random(stand.owner.shape) < 0.05
    depth_m = np.where(shown | (stand.owner == 1), stand.depth_m, 0).astype(np.float32)
    trees = stand.detections().select(np.zeros(9, np.intp))
    wall = np.zeros(stand.owner.shape, np.bool_)
    wall[[0, -1]] = True
    masks = [stand.owner == 1] * 8 + [wall]
    found = measure_trees(
        trees, depth_m, stand.camera, masks=masks, up_camera=stand.up, settings=None
    )
    assert [tree.cut_height_m.value for tree in found[:8]] == pytest.approx([0.25] * 8, abs=0.02)


def test_twigs_and_background_inside_the_mask_are_ignored(scene, pole):
    stand = scene(pole(0.3, -0.4, 5.0))
    rng = np.random.default_rng(3)
    mask = stand.owner == 1
    depth_m = stand.depth_m.copy()
    twigs = mask & (rng.random(mask.shape) < 0.25)
    gaps = mask & (rng.random(mask.shape) < 0.15)
    depth_m[twigs] -= rng.uniform(0.2, 1.5, mask.shape).astype(np.float32)[twigs]
    depth_m[gaps] += 6.0
    wide = np.roll(mask, 4, 1) | np.roll(mask, -4, 1)
    tree = stand.measure(stand.detections([wide]), depth_m)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.01)
    assert tree.distance_m.value == pytest.approx(
        np.linalg.norm(stand.axis_point(stand.poles[0], 0.25)), rel=0.005
    )


@pytest.mark.parametrize("ahead_m", [2.5, 5.0, 8.0])
def test_errors_under_noise_match_the_standard_deviations(scene, pole, exact, ahead_m):
    stand = scene(pole(0.3, 0.5, ahead_m))
    settings = replace(exact, keypoint_std_px=1.0)
    distance_m = float(np.linalg.norm(stand.axis_point(stand.poles[0], 0.25)))
    trees = replace(stand.detections(), masks=None)
    ratios = []
    for seed in range(60):
        keypoints = trees.keypoints_px.copy()
        keypoints[..., :2] += np.random.default_rng(seed + 99).normal(0, 1.0, (1, 5, 2))
        noisy = replace(trees, keypoints_px=keypoints)
        tree = stand.measure(noisy, stand.noisy_depth_m(seed), settings=settings)
        pairs = [(tree.diameter_m, 0.3), (tree.distance_m, distance_m), (tree.cut_height_m, 0.25)]
        ratios.append([(estimate.value - truth) / estimate.std for estimate, truth in pairs])
    spread = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all(spread[:2] > 0.8), spread
    assert np.all(spread < 1.25), spread


def test_more_noise_gives_larger_standard_deviations(scene, pole, exact):
    stand = scene(pole(0.3, 0.5, 6.0))
    quiet = stand.measure(depth_m=stand.noisy_depth_m(1, 0.001))
    loud = stand.measure(depth_m=stand.noisy_depth_m(1, 0.01))
    assert loud.distance_m.std > 2 * quiet.distance_m.std
    stand = scene(pole(0.3, 0.5, 6.0, 10.0, 0.0))
    bare = replace(stand.detections(), masks=None)
    blurred = stand.measure(bare, settings=replace(exact, keypoint_std_px=3.0))
    sharp = stand.measure(bare)
    assert blurred.diameter_m.std > 5 * sharp.diameter_m.std
    assert blurred.inclination_deg.std > 1.3 * sharp.inclination_deg.std
    masked = [stand.measure(settings=replace(exact, keypoint_std_px=std)) for std in (0.1, 3.0)]
    assert masked[1].cut_height_m.std > 1.2 * masked[0].cut_height_m.std


def test_low_keypoint_scores_give_larger_standard_deviations(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0))
    sure = replace(stand.detections(), masks=None)
    flat = sure.keypoints_px.copy()
    flat[..., 2] = 0.04
    unsure = replace(sure, keypoints_px=flat)
    sure, unsure = (stand.measure(trees, settings=None) for trees in (sure, unsure))
    assert unsure.diameter_m.value == pytest.approx(sure.diameter_m.value, rel=1e-3)
    widened = [unsure.evidence.source_std_m, sure.evidence.source_std_m]
    assert widened[0]["keypoints"] > 2 * widened[1]["keypoints"]
    assert unsure.diameter_m.std > 1.2 * sure.diameter_m.std
    assert unsure.cut_height_m.std > 1.2 * sure.cut_height_m.std


def test_trees_keep_their_order_and_do_not_mix(scene, pole):
    stand = scene(pole(0.2, -1.0, 4.0), pole(0.5, 0.2, 6.0), pole(0.35, 1.4, 3.5))
    trees = measure_trees(stand.detections(), stand.depth_m, stand.camera, up_camera=stand.up)
    assert [t.diameter_m.value for t in trees] == pytest.approx([0.2, 0.5, 0.35], rel=0.005)
    assert [t.cut_height_m.value for t in trees] == pytest.approx([0.25] * 3, abs=0.01)


def test_swapped_edges_give_the_same_diameter(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0))
    trees = stand.detections()
    swapped = replace(trees, keypoints_px=trees.keypoints_px[:, [0, 2, 1, 3, 4]])
    assert stand.measure(swapped).diameter_m == stand.measure(trees).diameter_m


@pytest.mark.parametrize("bend_per_m", [0.08, -0.08])
@pytest.mark.parametrize("diameter_m", [0.1, 0.5])
def test_the_ground_at_the_stem_counts_where_it_bends(scene, pole, diameter_m, bend_per_m):
    stem = pole(diameter_m, 0.2, 4.0)
    stand = scene(stem, camera_height_m=1.8, pitch_deg=20.0)
    rows, columns = np.nonzero(stand.owner == 0)
    depth_m = stand.depth_m.copy()
    rays = pixels_to_rays(stand.camera, np.stack([columns, rows], -1) + 0.5)
    beside_m = rays * depth_m[rows, columns][:, None] - stand.foot(stem)
    away_m = np.maximum(np.linalg.norm(beside_m, axis=1) - diameter_m / 2, 0)
    # A ray that meets the ground at the depth z meets a height h above it at z (1 - h / height).
    depth_m[rows, columns] *= 1 - bend_per_m * np.minimum(away_m, 1.5) ** 2 / 1.8
    height = stand.measure(depth_m=depth_m).cut_height_m
    assert height.value == pytest.approx(0.25, abs=0.02)
