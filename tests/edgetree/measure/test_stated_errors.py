"""Stated errors follow the image size, borders, unread samples, ragged outlines and the butt."""

from dataclasses import replace

import numpy as np
import pytest

from calib import PinholeCamera
from edgetree.detections import KEYPOINT_NAMES
from edgetree.measure import MeasureSettings
from edgetree.measure.keypoints import LEFT, RIGHT, Keypoints


@pytest.fixture(scope="module")
def stand(scene, pole):
    return scene(pole(0.3, 0.5, 4.0))


def relative_std(tree):
    return tree.diameter_m.std / tree.diameter_m.value


def test_an_image_of_half_the_size_gives_keypoints_of_half_the_error(stand):
    trees = stand.detections()
    half = replace(
        trees,
        boxes_px=trees.boxes_px / 2,
        keypoints_px=trees.keypoints_px * np.array([0.5, 0.5, 1], np.float32),
        image_width=640,
        image_height=360,
    )
    whole_px = Keypoints.from_detections(trees, MeasureSettings()).std_px
    assert Keypoints.from_detections(half, MeasureSettings()).std_px == pytest.approx(whole_px / 2)


def test_keypoints_have_the_deviations_of_their_heat_maps(stand):
    trees = stand.detections()
    settings = MeasureSettings()
    stds_px = np.full((len(trees), len(KEYPOINT_NAMES), 2), 40.0, np.float32)
    stds_px[:, LEFT] = 0.0
    usual = Keypoints.from_detections(trees, settings).std_px
    sure = Keypoints.from_detections(replace(trees, keypoint_stds_px=stds_px), settings).std_px
    shares = np.array([settings.keypoint_heat, settings.keypoint_heat_slide])
    assert sure[:, RIGHT] == pytest.approx(
        np.hypot(settings.keypoint_std_px, 40.0 * shares) * np.ones((len(trees), 1))
    )
    assert sure[:, LEFT] == pytest.approx(usual[:, LEFT])


@pytest.mark.parametrize("quantity", ["axis_distance_m", "distance_m"])
def test_the_noise_of_the_depth_moves_distances_by_as_much_as_stated(stand, exact, quantity):
    # The readings lie above the section: errors of distance and tilt cancel at the camera's level.
    noisy = replace(exact, depth_noise_per_m=0.01, depth_correlation_px=1.0)
    rng = np.random.default_rng(0)
    found = []
    for _ in range(40):
        noise = rng.normal(0, noisy.depth_noise_per_m, stand.depth_m.shape)
        depth_m = np.where(stand.depth_m > 0, stand.depth_m + noise * stand.depth_m**2, 0.0)
        found.append(getattr(stand.measure(depth_m=depth_m, settings=noisy), quantity))
    scatter_m = np.std([each.value for each in found])
    assert 0.7 < scatter_m / np.mean([each.std for each in found]) < 1.3


@pytest.mark.parametrize(("right_m", "keypoint"), [(-2.0, LEFT), (2.0, RIGHT)])
def test_a_keypoint_near_the_side_that_cuts_the_stem_off_is_doubted(scene, pole, right_m, keypoint):
    stand = scene(pole(0.5, right_m, 2.0))
    trees = stand.detections()
    side_px = 0 if right_m < 0 else trees.image_width
    keypoints = trees.keypoints_px.copy()
    keypoints[0, keypoint, 0] = side_px + (20 if right_m < 0 else -20)
    trees = replace(trees, keypoints_px=keypoints)
    width_px = abs(keypoints[0, RIGHT, 0] - keypoints[0, LEFT, 0])
    std_px = Keypoints.from_detections(trees, MeasureSettings()).std_px[0, :, 0]
    assert std_px[keypoint] > 0.2 * width_px
    others = [n for n in range(len(KEYPOINT_NAMES)) if n != keypoint]
    assert (std_px[others] < 0.05 * width_px).all()


def test_a_file_that_finds_edges_less_exactly_has_larger_errors(stand):
    trees = stand.detections()
    rough = replace(trees, error_factor=2.0).above(0.0)
    usual, twice = (stand.measure(each, settings=None) for each in (trees, rough))
    stds_m = [tree.evidence.source_std_m["mask"] for tree in (usual, twice)]
    assert stds_m[1] == pytest.approx(2 * stds_m[0], rel=0.1)
    assert relative_std(twice) > 1.2 * relative_std(usual)
    assert twice.distance_m.value == pytest.approx(usual.distance_m.value, rel=0.01)


def test_edges_are_less_exact_where_readings_fill_squares_of_pixels(scene, pole):
    small = PinholeCamera(640, 360, 350.0, 350.0, 319.5, 179.5)
    stand = scene(pole(0.3, 0.5, 4.0), camera=small)
    trees = replace(stand.detections(), by_network=True)
    noise = np.random.default_rng(0).normal(1.0, 0.002, stand.depth_m.shape)
    fine_m = np.where(stand.depth_m > 0, stand.depth_m * noise, 0.0)
    coarse_m = fine_m[::2, ::2].repeat(2, 0).repeat(2, 1)
    fine, coarse = (
        stand.measure(trees, depth_m=each, settings=None) for each in (fine_m, coarse_m)
    )
    assert coarse.evidence.source_std_m["mask"] > 1.15 * fine.evidence.source_std_m["mask"]


def test_depth_on_a_part_of_the_stem_widens_the_interval(stand):
    whole = stand.measure(settings=None)
    depth_m = stand.depth_m.copy()
    rows, _ = np.nonzero(stand.owner == 1)
    depth_m[int(np.quantile(rows, 0.4)) :][stand.owner[int(np.quantile(rows, 0.4)) :] == 1] = 0
    part = stand.measure(depth_m=depth_m, settings=None)
    careless = stand.measure(depth_m=depth_m, settings=MeasureSettings(readings_doubt=1e-6))
    assert relative_std(part) > 2 * relative_std(whole)
    assert relative_std(part) > 2 * relative_std(careless)
    # What makes the diameter doubtful makes the angles of the axis doubtful, too.
    assert part.inclination_deg.std > 1.1 * careless.inclination_deg.std


def test_a_ragged_outline_has_a_larger_error_than_a_straight_one(stand):
    mask = stand.owner == 1
    ragged = mask.copy()
    rng = np.random.default_rng(0)
    for row in np.flatnonzero(mask.any(1)):
        columns = np.flatnonzero(mask[row])
        cut = rng.integers(0, 7, 2)
        ragged[row, columns[0] : columns[0] + cut[0]] = False
        ragged[row, columns[-1] + 1 - cut[1] : columns[-1] + 1] = False
    straight, rough = (stand.measure_mask(given, settings=None) for given in (mask, ragged))
    mask_stds_m = [tree.evidence.source_std_m["mask"] for tree in (straight, rough)]
    assert mask_stds_m[1] > mask_stds_m[0]
    assert relative_std(rough) > 1.2 * relative_std(straight)


def test_the_butt_swell_is_added_where_the_lowest_edges_are_above_the_section(stand, exact):
    swollen = replace(exact, butt_swell=0.14, butt_swell_std=0.08)
    [pole] = stand.poles
    hidden = stand.owner == 1
    row = stand.keypoints(pole)[LEFT, 1]
    above_px = 0.6 * stand.camera.fy / stand.axis_point(pole, pole.section_m)[2]
    hidden[int(row - above_px) :] = False
    trees = replace(stand.detections(), masks=None)

    def by_mask(mask, settings):
        tree = stand.measure(trees, masks=[mask], settings=settings)
        return tree.evidence.source_diameters_m["mask"]

    low, high = stand.owner == 1, hidden
    assert by_mask(low, swollen) == pytest.approx(by_mask(low, exact), rel=0.03)
    share = 1 - np.exp(-0.6 / 0.6)
    assert by_mask(high, swollen) / by_mask(high, exact) == pytest.approx(
        1 + 0.14 * share, rel=0.03
    )
