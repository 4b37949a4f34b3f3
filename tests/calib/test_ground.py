"""The ground plane: exact, robust, deterministic, and no plane where there is none."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calib import CalibError, GroundPlane, GroundPlaneFailure, fit_ground_plane

Float = NDArray[np.floating[Any]]


def sloping_ground(count: int, noise_m: float = 0.0) -> tuple[Float, Float]:
    """Points of y = 1.5 + 0.1 x - 0.2 z (y down), and the upward normal."""
    rng = np.random.default_rng(3)
    x, z = rng.uniform(-2, 2, count), rng.uniform(3, 8, count)
    y = 1.5 + 0.1 * x - 0.2 * z + rng.normal(0, noise_m, count)
    normal = np.array([0.1, -1.0, -0.2])
    return np.stack([x, y, z], -1), normal / np.linalg.norm(normal)


def test_exact_points_give_their_plane() -> None:
    points, normal = sloping_ground(200)
    plane = fit_ground_plane(points)
    assert isinstance(plane, GroundPlane)
    np.testing.assert_allclose(plane.normal, normal, atol=1e-9)
    np.testing.assert_allclose(plane.height_m(points), 0.0, atol=1e-9)
    assert plane.height_m([0.0, 0.0, 0.0]) == pytest.approx(1.5 / np.linalg.norm([0.1, 1, 0.2]))
    assert plane.inlier_fraction == 1.0
    assert plane.points == 200
    assert plane.residual_std_m < 1e-9


def test_bushes_and_stems_on_the_ground_do_not_move_it() -> None:
    ground, normal = sloping_ground(600, noise_m=0.01)
    rng = np.random.default_rng(4)
    above = ground[:400] - np.outer(rng.uniform(0.15, 2.0, 400), [0.0, 1.0, 0.0])
    plane = fit_ground_plane(np.concatenate([ground, above]))
    assert isinstance(plane, GroundPlane)
    tilt_deg = np.degrees(np.arccos(min(1.0, float(plane.normal @ normal))))
    assert tilt_deg < 0.5
    assert abs(float(np.mean(plane.height_m(ground)))) < 0.005
    assert plane.inlier_fraction == pytest.approx(0.6, abs=0.04)
    assert plane.residual_std_m == pytest.approx(0.01, rel=0.2)


def test_a_wall_is_no_ground_whatever_it_holds() -> None:
    rng = np.random.default_rng(5)
    wall = np.stack([rng.uniform(-2, 2, 900), rng.uniform(-2, 1.4, 900), np.full(900, 6.0)], -1)
    ground, normal = sloping_ground(500)
    plane = fit_ground_plane(np.concatenate([wall, ground]))
    assert isinstance(plane, GroundPlane)
    assert float(plane.normal @ normal) > 0.9999
    assert isinstance(fit_ground_plane(wall), GroundPlaneFailure)


def test_up_decides_what_is_steep_and_where_the_normal_points() -> None:
    points, normal = sloping_ground(300)
    sideways = np.array([1.0, 0.0, 0.0])
    failure = fit_ground_plane(points, up=10 * sideways)
    assert isinstance(failure, GroundPlaneFailure)
    assert failure.reason == "no plane flatter than 45 degrees"
    upside_down = fit_ground_plane(points, up=-10 * normal)
    assert isinstance(upside_down, GroundPlane)
    np.testing.assert_allclose(upside_down.normal, -normal, atol=1e-9)


def test_noise_does_not_make_a_steep_bank_flat_enough() -> None:
    rng = np.random.default_rng(8)
    x, rise = rng.uniform(-0.5, 0.5, (2, 400))
    bank = np.stack([x, 1.5 - rise, 5.0 + rise / np.tan(np.radians(47.0))], -1)
    failure = fit_ground_plane(bank + rng.normal(0, 0.02, bank.shape))
    assert isinstance(failure, GroundPlaneFailure)
    assert failure.reason == "no plane flatter than 45 degrees"


def test_the_same_points_give_the_same_plane() -> None:
    points, _ = sloping_ground(500, noise_m=0.05)
    first, second = fit_ground_plane(points), fit_ground_plane(points)
    assert isinstance(first, GroundPlane)
    assert isinstance(second, GroundPlane)
    assert first.normal.tolist() == second.normal.tolist()


def test_what_cannot_be_fitted_is_a_falsy_reason() -> None:
    points, _ = sloping_ground(40)
    few = fit_ground_plane(np.concatenate([points[:11], np.full((9, 3), np.nan)]))
    assert not few
    assert isinstance(few, GroundPlaneFailure)
    assert few.reason == "11 ground points, expected at least 12"
    line = fit_ground_plane(np.outer(np.linspace(1, 2, 50), [1.0, 0.1, 3.0]))
    assert not line
    cloud = np.random.default_rng(6).uniform(-3, 3, (400, 3))
    scattered = fit_ground_plane(cloud, tolerance_m=0.05)
    assert isinstance(scattered, GroundPlaneFailure)
    assert "of the points, expected 30%" in scattered.reason


def test_points_near_one_line_give_no_plane() -> None:
    rng = np.random.default_rng(7)
    line = rng.normal([0.0, 1.5, 5.0], 0.002, (200, 3))
    line[:, 0] = np.linspace(-3, 3, 200)
    failure = fit_ground_plane(line)
    assert isinstance(failure, GroundPlaneFailure)
    assert failure.reason == "the ground points lie on one line"


@pytest.mark.parametrize("up", [[0, 0, 0], [0, 1], [0, np.nan, 1]])
def test_an_up_that_is_no_direction_is_refused(up: list[float]) -> None:
    points, _ = sloping_ground(40)
    with pytest.raises(CalibError, match="expected a direction of three numbers"):
        fit_ground_plane(points, up=up)
