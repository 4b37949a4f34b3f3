"""Depth whose edges are not those of the picture: smoothed, averaged over frames, or shifted."""

import cv2
import numpy as np
import pytest

from edgetree.measure import measure_trees

WALL_M = 10.0


@pytest.fixture(scope="module")
def stands(scene, pole):
    """Stems of several diameters and distances in front of a wall."""
    rng = np.random.default_rng(1000)
    made = []
    for diameter_m in (0.15, 0.2, 0.28, 0.37, 0.48):
        stem = pole(
            diameter_m,
            rng.uniform(-0.6, 0.6),
            rng.uniform(3, 6),
            rng.uniform(0, 5),
            70.0,
            top_m=6.0,
        )
        stand = scene(stem, slope_deg=rng.uniform(0, 6))
        far = (stand.depth_m == 0) | (stand.depth_m > WALL_M)
        stand.depth_m = np.where(far, np.float32(WALL_M), stand.depth_m)
        made.append(stand)
    return made


def shifted(depth_m, px):
    return np.roll(depth_m, px, axis=1)


FAULTS = {
    "mean 5x5": lambda depth_m: cv2.blur(depth_m, (5, 5)),
    "mean 7x7": lambda depth_m: cv2.blur(depth_m, (7, 7)),
    "mean 11x11": lambda depth_m: cv2.blur(depth_m, (11, 11)),
    "mean of disparities": lambda depth_m: 1 / cv2.blur(1 / depth_m, (7, 7)),
    "bilateral": lambda depth_m: cv2.bilateralFilter(depth_m, 9, 6.0, 4.0),
    "quarter size": lambda depth_m: cv2.resize(
        cv2.resize(depth_m, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA),
        depth_m.shape[::-1],
    ),
    "3 px left": lambda depth_m: shifted(depth_m, -3),
    "4 px right": lambda depth_m: shifted(depth_m, 4),
    "7 px right": lambda depth_m: shifted(depth_m, 7),
    "ghost": lambda depth_m: 0.4 * depth_m + 0.6 * shifted(depth_m, 5),
}


def measured(stands, fault, given=True):
    trees = []
    for seed, stand in enumerate(stands):
        depth_m = FAULTS[fault](stand.noisy_depth_m(seed)).astype(np.float32)
        masks = stand.masks() if given else None
        trees.append(stand.measure(depth_m=depth_m, masks=masks, settings=None))
    return trees


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("fault", FAULTS)
def test_the_depth_does_not_move_the_edges_of_an_exact_mask(stands, fault, given):
    for tree, stand in zip(measured(stands, fault, given), stands, strict=True):
        true_m = stand.poles[0].diameter_m
        assert tree.diameter_m.value == pytest.approx(true_m, rel=0.06)
        assert tree.dbh_m.value == pytest.approx(true_m, rel=0.03)
        for value in (tree.diameter_m, tree.dbh_m):
            assert abs(value.value - true_m) < 2.5 * value.std


@pytest.mark.parametrize("fault", ["mean 5x5", "mean 11x11", "quarter size"])
def test_smoothed_depth_has_a_warning(stands, fault):
    for tree in measured(stands, fault):
        assert any("the depth is smoothed over" in text for text in tree.evidence.warnings)


@pytest.mark.parametrize(("fault", "side"), [("3 px left", "left"), ("4 px right", "right")])
def test_depth_beside_the_picture_has_a_warning(stands, fault, side):
    for tree in measured(stands, fault):
        assert any(f"px to the {side} of the picture" in text for text in tree.evidence.warnings)


def test_exact_depth_has_no_such_warning(stands):
    for stand in stands:
        tree = stand.measure(masks=stand.masks(), settings=None)
        assert not any("the depth" in text for text in tree.evidence.warnings)


def test_background_that_is_grown_into_the_stem_has_a_large_enough_error(stands):
    """A filter that fills edges with the background looks like a mask that is too wide."""
    for seed, stand in enumerate(stands):
        depth_m = cv2.dilate(stand.noisy_depth_m(seed), np.ones((5, 5)))
        tree = stand.measure(depth_m=depth_m, masks=stand.masks(), settings=None)
        true_m = stand.poles[0].diameter_m
        assert abs(tree.dbh_m.value - true_m) < 2.5 * tree.dbh_m.std


def test_a_stem_thinner_than_the_filter_has_no_value(scene, pole):
    stand = scene(pole(0.12, 0.3, 9.0, top_m=6.0), pole(0.4, -1.0, 4.5, top_m=6.0))
    stand.depth_m = np.where(stand.depth_m == 0, np.float32(14.0), stand.depth_m)
    depth_m = cv2.blur(stand.depth_m, (15, 15))
    [thin, thick] = measure_trees(
        stand.detections(), depth_m, stand.camera, masks=stand.masks(), up_camera=stand.up
    )
    assert "smooths the depth" in thin.diameter_m.reason
    assert thick.diameter_m.value == pytest.approx(0.4, rel=0.05)


def test_breast_height_has_the_doubt_of_sources_that_disagree(stands):
    """Where keypoints tell another width than the mask, the mask is as doubtful higher up."""
    [stand] = stands[2:3]
    trees = stand.detections()
    wrong = trees.keypoints_px.copy()
    wrong[0, 1, 0] -= 12
    wrong[0, 2, 0] += 12
    agree, disagree = (
        stand.measure(stand.detections(), masks=stand.masks(), settings=None),
        stand.measure(
            type(trees)(**{**vars(trees), "keypoints_px": wrong}),
            masks=stand.masks(),
            settings=None,
        ),
    )
    assert disagree.dbh_m.std > 1.3 * agree.dbh_m.std
