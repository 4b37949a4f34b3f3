"""How a depth camera draws edges is told from the depth, and corrected in the edges of networks."""

from dataclasses import replace

import numpy as np
import pytest

from calib import PinholeCamera
from edgetree.measure import MeasureSettings, measure_trees
from edgetree.measure.depth_steps import depth_steps
from edgetree.measure.drawn_edges import AT_ONCE, GAP, UNKNOWN, drawn_edges

CAMERA = PinholeCamera(848, 480, 500.0, 500.0, 423.5, 239.5)
WALL_M = 9.0


def slope(step_m=None):
    """(96, 640) depth of ground that recedes, rounded to steps of `step_m(depth)`."""
    rng = np.random.default_rng(0)
    depth_m = np.linspace(8.0, 1.5, 96)[:, None] + rng.uniform(-0.2, 0.2, (96, 640))
    if step_m is None:
        return depth_m
    step = step_m(depth_m)
    return np.rint(depth_m / step) * step


def test_steps_of_disparities_are_told_from_those_of_a_file():
    disparity = 1 / (np.rint(400 / slope() / 0.125) * 0.125 / 400)
    assert depth_steps(disparity).of_disparities
    assert not depth_steps(slope(lambda depth_m: 0.001)).of_disparities
    assert not depth_steps(slope(lambda depth_m: 0.02)).of_disparities


@pytest.mark.parametrize("side", [1, 2, 3, 4])
def test_squares_of_pixels_that_share_a_reading_are_found(side):
    coarse = slope()
    full = np.repeat(np.repeat(coarse, side, 0), side, 1)[:, 1:]
    assert depth_steps(full).side_px == side


def stations(left, right):
    """(2, 1, 24) what follows a stem's edges, from counts at once and after a gap."""
    sides = [
        [AT_ONCE] * at_once + [GAP] * gap + [UNKNOWN] * (24 - at_once - gap)
        for at_once, gap in (left, right)
    ]
    return np.array(sides)[:, None]


def test_the_kind_of_camera_is_told_from_the_gaps_beside_stems():
    plain, disparities = depth_steps(slope()), None
    disparities = replace_steps(plain)
    exact = drawn_edges(stations((24, 0), (24, 0)), 0.3, plain)
    assert exact.outwards_px == pytest.approx(0.0, abs=0.1)
    flight = drawn_edges(stations((16, 8), (15, 7)), 0.6, plain)
    assert flight.outwards_px < -0.15
    stereo = drawn_edges(stations((8, 16), (22, 2)), 0.6, disparities)
    assert stereo.outwards_px == pytest.approx(0.8, abs=0.1)
    unknown = drawn_edges(stations((0, 0), (0, 0)), float("nan"), plain)
    assert unknown.std_px > 1.2 * max(exact.std_px, stereo.std_px)


def replace_steps(steps):
    return steps._replace(of_disparities=True)


def inwards(trees, px):
    """Detections by a network, whose masks and keypoints are `px` too narrow on each side."""
    boxes, keypoints = trees.boxes_px.copy(), trees.keypoints_px.copy()
    boxes[:, 0] += px
    boxes[:, 2] -= px
    keypoints[:, 1, 0] += px
    keypoints[:, 2, 0] -= px
    return replace(trees, boxes_px=boxes, keypoints_px=keypoints, by_network=True)


@pytest.fixture(scope="module")
def stand(scene, pole):
    poles = (pole(0.2, -1.0, 4.0, top_m=6.0), pole(0.3, 0.2, 5.0, top_m=6.0))
    made = scene(*poles, pole(0.25, 1.6, 4.5, top_m=6.0), camera=CAMERA)
    made.depth_m = np.where(made.depth_m == 0, np.float32(WALL_M), made.depth_m)
    return made


def dbh_errors_m(stand, trees, depth_m):
    found = measure_trees(trees, depth_m, stand.camera, up_camera=stand.up)
    return np.array([tree.dbh_m.value for tree in found]) - [0.2, 0.3, 0.25]


@pytest.mark.parametrize("px", [-1.2, 0.0, 1.2])
def test_the_depth_corrects_edges_that_a_network_puts_elsewhere(stand, px):
    errors_m = dbh_errors_m(stand, inwards(stand.detections(), px), stand.depth_m)
    assert np.abs(errors_m.mean()) < 0.005


def test_surfaces_that_stereo_extends_do_not_widen_stems(stand):
    """Each edge reaches a pixel too far at three of four places; one side has shadows."""
    rng = np.random.default_rng(3)
    inverse = 1 / stand.depth_m.astype(np.float64)
    grown = np.maximum(inverse, np.maximum(np.roll(inverse, 1, 1), np.roll(inverse, -1, 1)))
    edge = grown > 1.1 * inverse
    extended = np.where(edge & (rng.random(edge.shape) < 0.8), grown, inverse)
    shadow = np.zeros(edge.shape, np.bool_)
    for px in (1, 2, 3, 4):
        shadow |= np.roll(extended, -px, 1) > 1.1 * extended
    disparity = np.rint(extended * 45 / 0.0625) * 0.0625
    depth_m = np.where(shadow, 0.0, 45 / disparity).astype(np.float32)
    errors_m = dbh_errors_m(stand, inwards(stand.detections(), 0.0), depth_m)
    assert np.abs(errors_m.mean()) < 0.005


def test_a_lone_stem_has_no_ground(scene, pole):
    """What a network's mask leaves of a stem is not the ground beside it."""
    camera = PinholeCamera(240, 180, 185.0, 185.0, 119.5, 89.5)
    made = scene(pole(0.25, 0.0, 1.5, top_m=4.0), camera=camera, camera_height_m=1.4, pitch_deg=0.0)
    depth_m = np.where(made.owner == 1, made.depth_m, 0).astype(np.float32)
    trees = inwards(made.detections(), 3.0)
    boxes = trees.boxes_px.copy()
    boxes[:, 3] -= 3
    [tree] = measure_trees(replace(trees, boxes_px=boxes), depth_m, camera)
    assert tree.evidence.ground.startswith("no ground")
    assert tree.diameter_m.value == pytest.approx(0.25, abs=0.015)


def test_detections_that_no_network_made_stay(stand):
    """Where a user puts masks and keypoints, no camera's way to draw edges has moved them."""
    given = replace(inwards(stand.detections(), 1.2), by_network=False)
    errors_m = dbh_errors_m(stand, given, stand.depth_m)
    assert errors_m.mean() < -0.01


def test_edges_of_a_network_are_no_better_than_a_pixel_of_a_small_image(scene, pole):
    camera = PinholeCamera(256, 192, 190.0, 190.0, 127.5, 95.5)
    made = scene(pole(0.3, 0.0, 3.0), camera=camera)
    std_m = [
        made.measure(replace(made.detections(), by_network=by), settings=None).diameter_m.std
        for by in (False, True)
    ]
    assert std_m[1] > 1.2 * std_m[0]


def test_swapped_edges_of_a_network_give_the_same_diameter(stand):
    trees = inwards(stand.detections(), 1.2)
    swapped = replace(trees, keypoints_px=trees.keypoints_px[:, [0, 2, 1, 3, 4]])
    found, same = (
        measure_trees(each, stand.depth_m, stand.camera, up_camera=stand.up)
        for each in (trees, swapped)
    )
    assert [tree.diameter_m for tree in same] == [tree.diameter_m for tree in found]


def test_what_a_network_adds_to_one_mask_does_not_move_its_keypoints(scene, pole):
    """Twigs before a stem, background through its crown, and a mask that is 4 px too wide."""
    made = scene(pole(0.3, -0.4, 5.0))
    rng = np.random.default_rng(3)
    mask, depth_m = made.owner == 1, made.depth_m.copy()
    twigs = mask & (rng.random(mask.shape) < 0.25)
    depth_m[twigs] -= rng.uniform(0.2, 1.5, mask.shape).astype(np.float32)[twigs]
    depth_m[mask & (rng.random(mask.shape) < 0.15)] += 6.0
    wide = np.roll(mask, 4, 1) | np.roll(mask, -4, 1)
    trees = replace(made.detections([wide]), by_network=True)
    for settings in (None, MeasureSettings(keypoint_std_px=0.1, mask_std_px=0.5)):
        tree = made.measure(trees, depth_m, settings=settings)
        assert tree.diameter_m.value == pytest.approx(0.3, rel=0.03)


def test_a_thing_in_front_does_not_move_a_networks_edges(scene, pole):
    made = scene(pole(0.3, 0.3, 4.0))
    mask, crossing = made.owner == 1, np.zeros(made.owner.shape, np.bool_)
    crossing[300:450] = True
    depth_m = np.where(crossing, np.minimum(made.depth_m, 3.2), made.depth_m)
    trees = replace(made.detections([mask & ~crossing]), by_network=True)
    for settings in (None, MeasureSettings(keypoint_std_px=0.1, mask_std_px=0.5)):
        tree = made.measure(trees, depth_m, settings=settings)
        assert tree.diameter_m.value == pytest.approx(0.3, rel=0.02)
