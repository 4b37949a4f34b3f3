"""Pixels, rays and points: pixel conventions, distortion, depth along z."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib import (
    CameraError,
    PinholeCamera,
    depth_to_points,
    image_to_opencv,
    opencv_to_image,
    pixels_to_points,
    pixels_to_rays,
    project_points,
)

Float = NDArray[np.floating[Any]]

PLAIN = PinholeCamera(1280, 720, 700.0, 690.0, 640.0, 355.0)
LENSES = [
    (),
    (-0.3, 0.1, 0.001, -0.002),
    (-0.17, 0.026, 1e-4, -2e-4, 0.0),
    (0.1, -0.2, 0.001, 0.001, 0.05),
    (0.4457, -2.5378, 8e-4, -4e-4, 1.4556, 0.3218, -2.359, 1.3833),
]
FISHEYES = [
    (0.0, 0.0, 0.0, 0.0),
    (-0.0347, -0.01, 0.0072, -0.0024),
    (-0.0767, 0.1079, -0.1228, 0.0466),
    (0.1, 0.05, -0.02, 0.004),
]


def camera_with(distortion: tuple[float, ...]) -> PinholeCamera:
    return replace(PLAIN, distortion=distortion)


def fisheye(terms: tuple[float, ...]) -> PinholeCamera:
    return PinholeCamera(1440, 1080, 694.0, 693.0, 719.5, 534.0, terms, "fisheye")


CAMERAS = [*map(camera_with, LENSES), *map(fisheye, FISHEYES)]


def matrix(camera: PinholeCamera) -> Float:
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])


def grid_px(camera: PinholeCamera) -> Float:
    x, y = np.meshgrid(np.linspace(0, camera.width, 21), np.linspace(0, camera.height, 13))
    return np.stack([x, y], -1)


def test_both_conventions_of_the_first_pixels_centre() -> None:
    assert image_to_opencv([0.5, 0.5]).tolist() == [0.0, 0.0]
    assert opencv_to_image([[0, 0], [3, 4]]).tolist() == [[0.5, 0.5], [3.5, 4.5]]


def test_the_ray_of_the_principal_point_looks_ahead() -> None:
    assert pixels_to_rays(PLAIN, [640.5, 355.5]).tolist() == [0.0, 0.0, 1.0]
    assert pixels_to_rays(PLAIN, [640.5 + 70, 355.5 - 69]).tolist() == [0.1, -0.1, 1.0]


@pytest.mark.parametrize("distortion", LENSES)
def test_projection_equals_opencv_plus_half_a_pixel(distortion: tuple[float, ...]) -> None:
    camera = camera_with(distortion)
    rng = np.random.default_rng(1)
    points = rng.uniform([-3, -2, 3], [3, 2, 9], (50, 3))
    lens = np.array(distortion) if distortion else np.zeros(4)
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix(camera), lens)[0][:, 0]
    np.testing.assert_allclose(project_points(camera, points), expected + 0.5, atol=1e-9)


@pytest.mark.parametrize("terms", FISHEYES)
def test_fisheye_projection_equals_opencv_plus_half_a_pixel(terms: tuple[float, ...]) -> None:
    camera = fisheye(terms)
    points = np.random.default_rng(1).uniform([-9, -9, 0.5], [9, 9, 9], (200, 3))
    points[0] = [0, 0, 1]
    expected = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), matrix(camera), np.array(terms)
    )[0][:, 0]
    np.testing.assert_allclose(project_points(camera, points), expected + 0.5, atol=1e-9)


@pytest.mark.parametrize("distortion", LENSES[1:])
def test_rays_equal_opencv(distortion: tuple[float, ...]) -> None:
    camera = camera_with(distortion)
    xy_px = grid_px(camera)[3:-3, 5:-5]
    expected = cv2.undistortPoints(
        xy_px.reshape(-1, 1, 2) - 0.5, matrix(camera), np.array(distortion)
    ).reshape(xy_px.shape)
    np.testing.assert_allclose(pixels_to_rays(camera, xy_px)[..., :2], expected, atol=1e-3)


def test_fisheye_rays_equal_opencv() -> None:
    camera = fisheye(FISHEYES[1])
    xy_px = grid_px(camera)
    expected = cv2.fisheye.undistortPoints(
        xy_px.reshape(-1, 1, 2) - 0.5, matrix(camera), np.array(camera.distortion)
    ).reshape(xy_px.shape)
    np.testing.assert_allclose(pixels_to_rays(camera, xy_px)[..., :2], expected, atol=1e-6)


@pytest.mark.parametrize("terms", FISHEYES)
def test_a_fisheye_sees_85_degrees_off_its_axis(terms: tuple[float, ...]) -> None:
    camera = fisheye(terms)
    turns = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    angles = np.radians(np.linspace(0, 85, 60))[:, None]
    rays = np.stack([np.tan(angles) * np.cos(turns), np.tan(angles) * np.sin(turns)], -1)
    rays = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], -1)
    back = pixels_to_rays(camera, project_points(camera, rays))
    np.testing.assert_allclose(back, rays, rtol=1e-7, atol=1e-9)


def test_rays_outside_a_fisheyes_range_are_finite() -> None:
    falling = fisheye((-0.3, 0.0, 0.0, 0.0))
    for camera in (falling, fisheye(FISHEYES[0])):
        rays = pixels_to_rays(camera, [[np.inf, 540.0], [-1e5, -np.inf], [720.0, 534.5]])
        assert np.isfinite(rays).all()
        assert np.abs(rays[..., :2]).max() < 60


@pytest.mark.parametrize("camera", CAMERAS)
def test_rays_project_back_onto_their_pixels(camera: PinholeCamera) -> None:
    xy_px = grid_px(camera)
    rays = pixels_to_rays(camera, xy_px)
    assert rays.shape == (*xy_px.shape[:-1], 3)
    np.testing.assert_allclose(project_points(camera, rays * 4.2), xy_px, atol=1e-6)


def test_a_non_invertible_distortion_gives_finite_rays() -> None:
    camera = camera_with((-0.35, 0.15, 0.0, 0.0, -0.03))
    rays = pixels_to_rays(camera, grid_px(camera))
    assert np.isfinite(rays).all()
    assert np.isfinite(pixels_to_rays(camera, [[1e30, -1e30], [0.0, 1e30]])).all()
    middle = np.array([[500.0, 300.0], [800.0, 500.0]])
    np.testing.assert_allclose(
        project_points(camera, pixels_to_rays(camera, middle)), middle, atol=1e-6
    )


def test_depth_is_along_the_optical_axis() -> None:
    point = pixels_to_points(PLAIN, [[640.5 + 350, 355.5]], [4.0])
    np.testing.assert_allclose(point, [[2.0, 0.0, 4.0]])


def test_points_behind_the_camera_project_to_infinity() -> None:
    px = project_points(PLAIN, [[0.1, 0.2, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    assert np.isinf(px[:2]).all()
    assert px[2].tolist() == [640.5, 355.5]


def test_depth_to_points_uses_pixel_centres() -> None:
    camera = PinholeCamera(6, 4, 5.0, 5.0, 2.0, 1.0)
    depth_m = np.full((4, 6), 2.0, np.float32)
    depth_m[3, 5] = 0.0
    points = depth_to_points(camera, depth_m)
    assert points.shape == (4, 6, 3)
    assert points[1, 2].tolist() == [0.0, 0.0, 2.0]
    np.testing.assert_allclose(points[0, 5], [1.2, -0.4, 2.0])
    assert points[3, 5].tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("distortion", LENSES)
def test_a_depth_maps_points_project_onto_its_pixels(distortion: tuple[float, ...]) -> None:
    camera = camera_with(distortion).scaled(64, 36)
    depth_m = np.random.default_rng(2).uniform(1, 20, (36, 64)).astype(np.float32)
    points = depth_to_points(camera, depth_m)
    rows, columns = np.mgrid[0:36, 0:64]
    expected = np.stack([columns, rows], -1) + 0.5
    np.testing.assert_allclose(project_points(camera, points), expected, atol=1e-6)
    np.testing.assert_array_equal(points[..., 2], depth_m)


def test_blocks_of_points_are_projected_independently() -> None:
    camera = CAMERAS[4]
    points = np.random.default_rng(3).uniform([-3, -2, -1], [3, 2, 9], (20_001, 3))
    some = [0, 8191, 8192, 20_000]
    np.testing.assert_array_equal(
        project_points(camera, points)[some], [project_points(camera, points[i]) for i in some]
    )


def test_a_depth_map_of_another_size_is_rejected() -> None:
    with pytest.raises(CameraError) as caught:
        depth_to_points(PLAIN, np.zeros((4, 6), np.float32))
    assert str(caught.value) == "the depth map is 6x4 px: expected the camera's 1280x720"
