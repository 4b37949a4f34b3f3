"""Rigs that are a little off: what is given holds, for rigs that state their errors and others."""

from dataclasses import replace

import numpy as np
import pytest

from calib import RigidTransform
from edgetree.measure import RigUncertainty, measure_trees

QUANTITIES = ("diameter_m", "distance_m", "axis_distance_m", "cut_height_m", "inclination_deg")
STATED = RigUncertainty(0.012, 9.0, 2.5, 2.5)


def turned(rng, std_deg):
    """A random small rotation."""
    angles = rng.normal(0, std_deg, 3)
    return RigidTransform.from_euler_deg(*angles, np.zeros(3)).rotation


def offs(scene, pole, seed, rig, exact):
    """Errors in standard deviations of one random stem, seen by a rig with random errors."""
    rng = np.random.default_rng(seed)
    ahead_m = rng.uniform(3.5, 9)
    stem = pole(
        rng.uniform(0.15, 0.5), rng.uniform(-0.5, 0.5) * ahead_m, ahead_m, rng.uniform(0, 6)
    )
    stand = scene(stem, slope_deg=rng.uniform(0, 10), pitch_deg=rng.uniform(0, 12))
    given = stand.camera
    errors = rig.errors(given)
    s, p, q = rng.normal(0, (errors.scale, errors.ray, errors.ray))
    told = replace(given, cx=given.cx - p * given.fx, cy=given.cy - q * given.fy)
    up = turned(rng, np.degrees(errors.vertical_rad)) @ np.asarray(stand.up)
    mounting = RigidTransform.mounting([1.5, 0.0, 2.2], 0.0, 0.0, 0.0)
    moved = RigidTransform(
        turned(rng, np.degrees(errors.mounting_rad)) @ mounting.rotation, mounting.translation_m
    )
    options = {"masks": stand.masks(), "settings": exact, "rig_uncertainty": rig}
    trees = stand.detections()
    depth_m = stand.depth_m * np.float32(1 + s)
    [tree] = measure_trees(trees, depth_m, told, up_camera=up, mounting=moved, **options)
    [true] = measure_trees(
        trees, stand.depth_m, given, up_camera=stand.up, mounting=mounting, **options
    )
    found = [
        (getattr(tree, name).value - getattr(true, name).value) / getattr(tree, name).std
        for name in QUANTITIES
        if getattr(tree, name) and getattr(true, name)
    ]
    for name in ("cut_point_m", "cut_point_machine_m"):
        point, right = getattr(tree, name), getattr(true, name)
        if point and right:
            found += ((point.xyz_m - right.xyz_m) / point.std_m).tolist()
    return found


@pytest.mark.parametrize("rig", [RigUncertainty(), STATED])
def test_what_a_rig_that_is_off_gives_holds(scene, pole, exact, rig):
    found = np.concatenate([offs(scene, pole, seed, rig, exact) for seed in range(1000, 1020)])
    assert len(found) > 150
    assert np.mean(np.abs(found) > 3) < 0.02
    assert np.mean(np.abs(found) < 1.96) > 0.9
