"""Depth registration, compared with scenes ray-cast in both cameras."""

from itertools import groupby
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib import CameraError, PinholeCamera, RigidTransform, depth_to_points, register_depth

Float = NDArray[np.floating[Any]]

DEPTH = PinholeCamera(212, 120, 105.0, 105.0, 105.5, 60.0)
COLOURS = [
    PinholeCamera(320, 180, 190.0, 190.0, 160.0, 89.0, (-0.1, 0.02, 1e-3, -1e-3)),
    PinholeCamera(480, 270, 290.0, 288.0, 240.0, 135.0),
    PinholeCamera(80, 60, 55.0, 55.0, 40.0, 30.0),
    PinholeCamera(240, 180, 110.0, 110.0, 120.0, 90.0, (-0.03, -0.01, 7e-3, -2e-3), "fisheye"),
]
# The depth camera looks 5 degrees down; x right, y down, z forward of a level frame below it.
LEVEL = RigidTransform.from_euler_deg(-5, 0, 0, np.zeros(3))
GROUND_M, WALL_M = 1.5, 12.0
BOX_M = np.array([[-0.8, -0.5, 4.0], [0.6, 1.5, 5.0]])


def cast(camera: PinholeCamera, camera_to_level: RigidTransform, with_box: bool = True) -> Float:
    """Return (H, W) metres along z to the nearest of ground, wall and box."""
    ones = np.ones((camera.height, camera.width), np.float32)
    rays = camera_to_level.rotate(depth_to_points(camera, ones))
    start = camera_to_level.translation_m
    with np.errstate(divide="ignore"):
        ground = (GROUND_M - start[1]) / rays[..., 1]
        wall = (WALL_M - start[2]) / rays[..., 2]
        sides = (BOX_M[:, None, None] - start) / rays
    enter, leave = sides.min(0).max(-1), sides.max(0).min(-1)
    box = np.where(with_box & (enter < leave) & (enter > 0), enter, np.inf)
    return np.minimum(np.minimum(np.where(ground > 0, ground, np.inf), wall), box)


def move(seed: int) -> RigidTransform:
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-3, 3, 3)
    return RigidTransform.from_euler_deg(*angles, rng.uniform(-0.1, 0.1, 3))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("colour", COLOURS)
def test_a_registered_scene_equals_the_ray_cast_scene(colour: PinholeCamera, seed: int) -> None:
    depth_to_colour = move(seed)
    registered = register_depth(cast(DEPTH, LEVEL), DEPTH, colour, depth_to_colour)
    expected = cast(colour, depth_to_colour.inverse().then(LEVEL))
    assert registered.dtype == np.float32
    covered = registered > 0
    agree = np.isclose(registered, expected, rtol=2e-3)
    assert agree[covered].mean() > 0.985  # except pixels on the box's outline
    nearer = registered[covered] < expected[covered] * 0.99
    assert nearer.mean() < 0.012


@pytest.mark.parametrize("colour", COLOURS)
def test_surfaces_have_no_holes(colour: PinholeCamera) -> None:
    noise = np.random.default_rng(0).normal(1, 0.005, (DEPTH.height, DEPTH.width))
    depth_m = cast(DEPTH, LEVEL, with_box=False) * noise
    covered = register_depth(depth_m, DEPTH, colour, move(1)) > 0
    contours, _ = cv2.findContours(
        covered.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    filled = cv2.drawContours(np.zeros(covered.shape, np.uint8), contours, -1, 1, cv2.FILLED)
    assert len(contours) == 1
    assert covered.mean() > 0.4
    np.testing.assert_array_equal(filled.astype(bool), covered)


def test_parts_hidden_from_the_depth_camera_have_no_depth() -> None:
    aside = RigidTransform(np.eye(3), np.array([0.5, 0.0, 0.0]))
    depth_m = np.full((DEPTH.height, DEPTH.width), 8.0)
    depth_m[40:80, 90:120] = 2.0
    registered = register_depth(depth_m, DEPTH, DEPTH, aside)
    values = {round(float(value), 3) for value in np.unique(registered)}
    assert values == {0.0, 2.0, 8.0}
    # The background moves by 6.6 px, the foreground by 26.2 px, which uncovers unknown background.
    found = "".join({0.0: ".", 2.0: "n", 8.0: "f"}[round(float(z), 3)] for z in registered[60])
    runs = [(key, len(list(run))) for key, run in groupby(found)]
    assert runs == [(".", 6), ("f", 91), (".", 19), ("n", 30), ("f", 66)]


def test_a_one_pixel_pole_is_not_tilted_towards_the_background() -> None:
    aside = RigidTransform(np.eye(3), np.array([0.5, 0.0, 0.0]))
    depth_m = np.full((DEPTH.height, DEPTH.width), 8.0)
    depth_m[:, 90] = 3.0
    registered = register_depth(depth_m, DEPTH, COLOURS[1], aside)
    assert {round(float(value), 3) for value in np.unique(registered)} == {0.0, 3.0, 8.0}


def test_the_same_camera_keeps_its_depth() -> None:
    depth_m = cast(DEPTH, LEVEL).astype(np.float32)
    depth_m[5:9, 5:9] = 0
    registered = register_depth(depth_m, DEPTH, DEPTH, RigidTransform.identity())
    np.testing.assert_allclose(registered, depth_m, rtol=1e-6)


def test_points_outside_the_colour_cameras_view_are_left_out() -> None:
    depth_m = cast(DEPTH, LEVEL)
    turned = RigidTransform.from_euler_deg(0, 180, 0, np.zeros(3))
    assert not register_depth(depth_m, DEPTH, COLOURS[0], turned).any()
    passed = RigidTransform(np.eye(3), np.array([0.0, 0.0, -4.5]))
    registered = register_depth(depth_m, DEPTH, COLOURS[0], passed)
    assert np.isfinite(registered).all()
    assert registered.max() < WALL_M


def test_a_map_without_readings_stays_empty() -> None:
    depth_m = np.zeros((DEPTH.height, DEPTH.width), np.float32)
    depth_m[3, 3] = np.nan
    assert not register_depth(depth_m, DEPTH, COLOURS[0], move(0)).any()


def test_a_map_of_another_size_is_rejected() -> None:
    with pytest.raises(CameraError, match="the depth map is 6x4 px: expected the camera's 212x120"):
        register_depth(np.ones((4, 6)), DEPTH, COLOURS[0], move(0))
