"""Stems are measured from single beams of a scanner, which are not filled in."""

import numpy as np
import pytest

from calib import PinholeCamera
from edgetree import TreeDetections
from edgetree.measure import EXACT_RIG, measure_trees

CAMERA = PinholeCamera(1280, 720, fx=700.0, fy=700.0, cx=639.5, cy=359.5)
UP = (0.0, -1.0, 0.0)
RADIUS_M, AWAY_M = 0.15, 5.0


def post_depth(right_m=0.0):
    """Exact depth of an upright post before a wall at 9 m, and the post's mask."""
    x = (np.arange(1280) - CAMERA.cx) / CAMERA.fx
    # The nearer crossing of the ray (x, 1) with the circle around (right, away).
    a, b = 1 + x**2, x * right_m + AWAY_M
    root = b**2 - a * (right_m**2 + AWAY_M**2 - RADIUS_M**2)
    z = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, 9.0)
    depth_m = np.broadcast_to(z, (720, 1280)).copy()
    mask = np.zeros((720, 1280), bool)
    mask[40:640] = root > 0
    depth_m[640:] = 9.0
    return depth_m.astype(np.float32), mask


def sparse(depth_m, rng, rows_px=20, columns_px=4, noise_m=0.02):
    """Every so many rows and columns of a depth image, with noise."""
    beams = np.zeros_like(depth_m)
    beams[::rows_px, ::columns_px] = depth_m[::rows_px, ::columns_px]
    noise = rng.normal(0, noise_m, beams.shape)
    return np.where(beams > 0, beams + noise, 0.0).astype(np.float32)


def measured(depth_m, mask, **options):
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    box = [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
    trees = TreeDetections(
        np.array([box], np.float32), np.ones(1, np.float32), None, None, 1280, 720
    )
    (tree,) = measure_trees(
        trees, depth_m, CAMERA, masks=mask[None], up_camera=UP, rig_uncertainty=EXACT_RIG, **options
    )
    return tree


@pytest.mark.parametrize(("rows_px", "columns_px"), [(35, 5), (20, 4), (8, 4), (2, 2)])
def test_a_stem_of_few_beams_has_its_diameter(rows_px, columns_px):
    exact, mask = post_depth()
    errors, stds = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        tree = measured(sparse(exact, rng, rows_px, columns_px), mask, sparse=True)
        errors.append(tree.diameter_m.value - 2 * RADIUS_M)
        stds.append(tree.diameter_m.std)
        assert tree.axis_distance_m.value == pytest.approx(AWAY_M, abs=3 * tree.axis_distance_m.std)
        assert tree.axis_distance_m.std < 0.05
    assert np.abs(errors).max() < 0.012
    assert np.median(stds) < 0.02


def test_beams_as_a_depth_image_are_refused():
    exact, mask = post_depth()
    tree = measured(sparse(exact, np.random.default_rng(0)), mask)
    assert not tree.diameter_m


def test_beams_of_the_wall_behind_are_no_stem():
    exact, mask = post_depth()
    wall = np.where(mask, 9.0, exact).astype(np.float32)
    tree = measured(sparse(wall, np.random.default_rng(0)), mask, sparse=True)
    assert "goes on beside it" in tree.diameter_m.reason


def test_some_beams_of_the_wall_among_those_of_the_stem_are_left_out():
    exact, mask = post_depth()
    rng = np.random.default_rng(1)
    past = np.where(rng.random(exact.shape) < 0.3, 9.0, exact).astype(np.float32)
    tree = measured(sparse(past, rng), mask, sparse=True)
    assert tree.axis_distance_m.value == pytest.approx(AWAY_M, abs=0.06)
    assert tree.diameter_m.value == pytest.approx(2 * RADIUS_M, abs=0.015)


def test_four_beams_are_too_few():
    exact, mask = post_depth()
    beams = np.zeros_like(exact)
    for row, column in ((100, 630), (200, 640), (300, 650), (400, 640)):
        beams[row, column] = exact[row, column]
    tree = measured(beams, mask, sparse=True)
    assert tree.diameter_m.reason == "no depth on the stem"


def test_the_noise_of_beams_is_that_of_scanners_unless_it_is_given():
    from edgetree.measure import MeasureSettings

    assert MeasureSettings().of_beams().depth_noise_m == 0.02
    assert MeasureSettings(depth_noise_m=0.05).of_beams().depth_noise_m == 0.05
