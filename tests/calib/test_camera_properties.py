"""Properties that hold for every camera, tested with random cameras of every distortion model."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import (
    PinholeCamera,
    RigidTransform,
    depth_to_range,
    load_camera,
    pixels_to_rays,
    project_points,
    range_to_depth,
    register_depth,
    save_camera,
)

SEEDS = range(12)


def random_camera(seed: int) -> PinholeCamera:
    """A typical camera, 30 to 120 degrees wide, with one of the distortion models."""
    rng = np.random.default_rng(seed)
    width, height = (int(side) for side in rng.integers(40, 90, 2) * 16)
    fx = width * rng.uniform(0.45, 1.5)
    lenses: list[tuple[str, tuple[float, ...]]] = [
        ("radtan", ()),
        ("radtan", (-0.06, 0.01, 1e-3, -1e-3)),
        ("radtan", (-0.06, 0.01, -1e-3, 1e-3, 1e-3)),
        ("radtan", (0.6, 0.1, 1e-3, -1e-3, 0.01, 0.7, 0.15, 0.02)),
        ("fisheye", (-0.03, 0.01, -0.01, 0.002)),
    ]
    model, terms = lenses[seed % len(lenses)]
    scatter = rng.uniform(0.5, 1.5, len(terms))
    cx, cy = np.array([width, height]) * rng.uniform(0.45, 0.55, 2)
    return PinholeCamera(
        width,
        height,
        fx,
        fx * rng.uniform(0.97, 1.03),
        cx,
        cy,
        tuple(np.multiply(terms, scatter)),
        model,
        rng.uniform(0, 3),
    )


def random_pixels(camera: PinholeCamera, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0, [camera.width, camera.height], (500, 2))


@pytest.mark.parametrize("seed", SEEDS)
def test_pixels_round_trip_through_points(seed: int) -> None:
    camera = random_camera(seed)
    xy_px = random_pixels(camera, seed)
    rays = pixels_to_rays(camera, xy_px)
    depths = np.random.default_rng(seed).uniform(0.3, 40, (len(xy_px), 1))
    np.testing.assert_allclose(project_points(camera, rays * depths), xy_px, atol=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_camera_file_round_trips_exactly(seed: int, tmp_path: Path) -> None:
    save_camera(tmp_path / "camera.json", random_camera(seed))
    assert load_camera(tmp_path / "camera.json") == random_camera(seed)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_resized_image_keeps_its_rays(seed: int) -> None:
    camera = random_camera(seed)
    xy_px = random_pixels(camera, seed)
    half = camera.scaled(camera.width // 2, camera.height // 2)
    np.testing.assert_allclose(
        pixels_to_rays(half, xy_px / 2), pixels_to_rays(camera, xy_px), atol=1e-9
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_a_crop_keeps_its_rays(seed: int) -> None:
    camera = random_camera(seed)
    part = camera.cropped(64, 32, camera.width // 2, camera.height // 2)
    xy_px = random_pixels(part, seed)
    expected = pixels_to_rays(camera, xy_px + np.array([64, 32]))
    np.testing.assert_allclose(pixels_to_rays(part, xy_px), expected, atol=1e-9)
    first_cropped = part.scaled(part.width // 2, part.height // 2)
    first_scaled = camera.scaled(camera.width // 2, camera.height // 2).cropped(
        32, 16, part.width // 2, part.height // 2
    )
    np.testing.assert_allclose(numbers(first_cropped), numbers(first_scaled))


def numbers(camera: PinholeCamera) -> list[float]:
    return [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy]


def small(seed: int) -> PinholeCamera:
    camera = random_camera(seed)
    return camera.scaled(camera.width // 16, camera.height // 16)


def depth_of(camera: PinholeCamera, seed: int) -> np.ndarray:
    depth_m = np.random.default_rng(seed).uniform(1, 30, (camera.height, camera.width))
    depth_m[np.random.default_rng(seed + 1).random(depth_m.shape) < 0.2] = 0
    return depth_m.astype(np.float32)


@pytest.mark.parametrize("seed", SEEDS)
def test_ranges_round_trip_through_depth(seed: int) -> None:
    camera = small(seed)
    ranges = depth_of(camera, seed)
    np.testing.assert_allclose(
        depth_to_range(range_to_depth(ranges, camera), camera), ranges, rtol=1e-6
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_depth_registered_to_its_own_camera_is_unchanged(seed: int) -> None:
    camera = small(seed)
    depth_m = depth_of(camera, seed)
    same = register_depth(depth_m, camera, camera, RigidTransform.identity())
    np.testing.assert_allclose(same, depth_m, rtol=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("turn", ["quaternion", "euler"])
def test_rotations_keep_lengths_and_angles(seed: int, turn: str) -> None:
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=4)
    builders: dict[str, Callable[[], RigidTransform]] = {
        "quaternion": lambda: RigidTransform.from_quaternion(
            quaternion / np.linalg.norm(quaternion), rng.normal(size=3)
        ),
        "euler": lambda: RigidTransform.from_euler_deg(
            *rng.uniform(-180, 180, 3), rng.normal(size=3)
        ),
    }
    transform = builders[turn]()
    points = rng.normal(size=(6, 3))
    turned = transform.rotate(points)
    np.testing.assert_allclose(turned @ turned.T, points @ points.T, atol=1e-12)
    np.testing.assert_allclose(
        np.cross(turned[0], turned[1]), transform.rotate(np.cross(points[0], points[1])), atol=1e-12
    )
    np.testing.assert_allclose(transform.inverse().apply(transform.apply(points)), points)


@pytest.mark.parametrize("seed", SEEDS)
def test_default_fields_are_not_written(seed: int) -> None:
    plain = replace(random_camera(seed), distortion=(), distortion_model="radtan", focal_std_px=0)
    names = ["width", "height", "fx", "fy", "cx", "cy", "distortion"]
    assert list(plain.to_dict()) == names
