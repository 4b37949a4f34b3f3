"""Masks that show more than the stem: too wide, with branch stubs, over background, or crude."""

import cv2
import numpy as np
import pytest

from calib import PinholeCamera, project_points
from edgetree import TreeDetections
from edgetree.measure import measure_trees

WALL_M = 9.0


@pytest.fixture(scope="module")
def stems(scene, pole):
    """Stems of several diameters and distances in front of a wall, each with the wall's depth."""
    poles = [
        pole(0.15, 0.4, 3.0, 3.0, 0.0, top_m=4.0),
        pole(0.25, -0.8, 4.5, 5.0, 120.0, top_m=5.0),
        pole(0.35, 0.5, 5.5, 2.0, 200.0, top_m=6.0),
        pole(0.5, -0.3, 4.0, 4.0, 300.0, top_m=5.0),
    ]
    stands = [scene(stem) for stem in poles]
    walls = []
    for stand in stands:
        open_sky = (stand.depth_m == 0) | (stand.depth_m > WALL_M)
        stand.depth_m = np.where(open_sky, np.float32(WALL_M), stand.depth_m)
        walls.append(background_m(scene))
    return list(zip(stands, walls, strict=True))


def background_m(scene):
    """(H, W) depth of ground and wall without the stem."""
    depth_m = scene().depth_m
    return np.where((depth_m == 0) | (depth_m > WALL_M), np.float32(WALL_M), depth_m)


def errors_and_hits(trees, stands):
    """Relative errors of the measured diameters, and which lie in their 95 % intervals."""
    errors, hits = [], []
    for tree, stand in zip(trees, stands, strict=True):
        if tree.diameter_m:
            true_m = stand.poles[0].diameter_m
            low_m, high_m = tree.diameter_m.interval95
            errors.append(tree.diameter_m.value / true_m - 1)
            hits.append(low_m < true_m < high_m)
        else:
            assert tree.diameter_m.reason
    return np.array(errors), np.array(hits)


@pytest.mark.parametrize("halo_px", [4, 8])
def test_a_mask_that_is_too_wide_is_cut_back_to_the_depth(stems, halo_px):
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * halo_px + 1,) * 2)
    trees = []
    for seed, (stand, _) in enumerate(stems):
        mask = cv2.dilate((stand.owner == 1).astype(np.uint8), kernel) > 0
        trees.append(stand.measure_mask(mask, depth_m=stand.noisy_depth_m(seed), settings=None))
    errors, hits = errors_and_hits(trees, [stand for stand, _ in stems])
    assert len(errors) == len(stems)
    assert np.abs(errors).max() < 0.06
    assert hits.all()


def test_a_mask_that_is_too_wide_against_the_sky_has_a_large_enough_error(scene, pole):
    """Readings that are missing beside the stem may be a fault of the depth, not of the mask."""
    stand = scene(pole(0.2, 0.3, 5.0, top_m=6.0), pitch_deg=-15.0)
    mask = cv2.dilate((stand.owner == 1).astype(np.uint8), np.ones((9, 9))) > 0
    tree = stand.measure_mask(mask, settings=None)
    low_m, high_m = tree.diameter_m.interval95
    assert low_m < 0.2 < high_m


@pytest.mark.parametrize("share", [0.5, 0.7])
def test_background_within_the_mask_is_not_the_stem(stems, share):
    trees = []
    for seed, (stand, wall_m) in enumerate(stems):
        mask = stand.owner == 1
        wrong = mask & (np.random.default_rng(seed).random(mask.shape) < share)
        depth_m = np.where(wrong, wall_m, stand.noisy_depth_m(seed))
        trees.append(stand.measure_mask(mask, depth_m=depth_m, settings=None))
    errors, hits = errors_and_hits(trees, [stand for stand, _ in stems])
    assert len(errors)
    assert np.median(np.abs(errors)) < 0.02
    assert hits.all()


def with_stubs(stand, count, share):
    """A mask with branch stubs on both sides over a share of the length, and depth with them."""
    [stem] = stand.poles
    own = stand.owner == 1
    mask, depth_m, along = own.copy(), stand.depth_m.copy(), stand.along(stem)
    length_m = 3.5
    half_m, reach_m = share * length_m / count / 2, 1.5 * stem.diameter_m / 2
    for number in range(count):
        centre = stand.axis_point(stem, (number + 0.5) / count * length_m)
        side = np.cross(along, stand.front(stem, centre))
        corners = [
            centre + across * reach_m * side + up * half_m * along
            for across, up in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        shape = np.zeros(own.shape, np.uint8)
        pixels = np.round(project_points(stand.camera, np.array(corners))).astype(np.int32)
        cv2.fillPoly(shape, [pixels], [1])
        stub = (shape > 0) & ~own
        mask |= stub
        depth_m[stub] = centre[2]
    return mask, depth_m


@pytest.mark.parametrize("share", [0.3, 0.45, 0.6])
def test_the_diameter_is_not_read_at_branch_stubs(stems, share):
    trees = []
    for stand, _ in stems:
        mask, depth_m = with_stubs(stand, 6, share)
        trees.append(stand.measure_mask(mask, depth_m=depth_m, settings=None))
    errors, hits = errors_and_hits(trees, [stand for stand, _ in stems])
    assert len(errors) == len(stems)
    assert np.abs(errors).max() < 0.05
    assert hits.all()


@pytest.mark.parametrize("rest", ["everything", "one side", "blobs"])
@pytest.mark.parametrize("diameter_m", [0.5, 0.6])
def test_a_mask_of_most_of_the_scene_is_measured_at_its_clean_rows(scene, pole, rest, diameter_m):
    camera = PinholeCamera(240, 180, 185.0, 185.0, 121.0, 88.0)
    stem = pole(diameter_m, 0.05, 2.0, 2.0, 40.0, top_m=6.0)
    stand = scene(stem, camera=camera, camera_height_m=1.3, pitch_deg=0.0)
    behind = (stand.depth_m == 0) | (stand.depth_m > 3.2)
    rng = np.random.default_rng(4)
    depth_m = np.where(behind, np.float32(3.2), stand.depth_m)
    depth_m = (depth_m + rng.normal(0, 0.008, depth_m.shape)).astype(np.float32)
    own = stand.owner == 1
    crude = {
        "everything": np.ones_like(own),
        "one side": own | (np.arange(240) > 130),
        "blobs": own | (cv2.GaussianBlur(rng.standard_normal(own.shape), (0, 0), 12) > -0.02),
    }[rest]
    clean = np.zeros(own.shape, bool)
    clean[50:95] = True
    mask = np.where(clean, own, crude)
    tree = stand.measure_mask(mask, depth_m=depth_m, level=True, settings=None)
    assert tree.diameter_m.value == pytest.approx(diameter_m, rel=0.05)
    low_m, high_m = tree.diameter_m.interval95
    assert low_m < diameter_m < high_m


@pytest.mark.parametrize("sides_px", [(-120, -30), (660, 740)])
def test_a_box_beside_the_picture_has_a_reason(sides_px):
    """Another project's network may give one."""
    trees = TreeDetections(
        np.array([[200, 20, 240, 340], [sides_px[0], 20, sides_px[1], 340]], np.float32),
        np.array([0.9, 0.5], np.float32),
        None,
        np.ones((2, 28, 28), np.float32),
        640,
        360,
        by_network=True,
    )
    camera = PinholeCamera(640, 360, 350.0, 350.0, 319.5, 179.5)

    beside = measure_trees(trees, np.full((360, 640), 3.0, np.float32), camera)[1]

    assert "show both edges of the stem" in beside.diameter_m.reason
