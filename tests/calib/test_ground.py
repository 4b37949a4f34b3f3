"""Ground plane fit: exact, robust, deterministic, and failures."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from basetree.errors import InputError
from calib import GroundPlane, GroundPlaneFailure, fit_ground_plane, fit_ground_planes

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


def test_bushes_and_trunks_do_not_move_the_plane() -> None:
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


def test_a_wall_is_not_ground() -> None:
    rng = np.random.default_rng(5)
    wall = np.stack([rng.uniform(-2, 2, 900), rng.uniform(-2, 0.3, 900), np.full(900, 6.0)], -1)
    ground, normal = sloping_ground(500)
    plane = fit_ground_plane(np.concatenate([wall, ground]))
    assert isinstance(plane, GroundPlane)
    assert float(plane.normal @ normal) > 0.9999
    assert isinstance(fit_ground_plane(wall), GroundPlaneFailure)


def test_up_sets_the_slope_and_the_normals_direction() -> None:
    points, normal = sloping_ground(300)
    sideways = np.array([1.0, 0.0, 0.0])
    failure = fit_ground_plane(points, up=10 * sideways)
    assert isinstance(failure, GroundPlaneFailure)
    assert failure.reason == "no plane flatter than 45 degrees"
    upside_down = fit_ground_plane(points, up=-10 * normal)
    assert isinstance(upside_down, GroundPlane)
    np.testing.assert_allclose(upside_down.normal, -normal, atol=1e-9)


def test_a_noisy_steep_bank_is_still_too_steep() -> None:
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


def test_failures_are_falsy_with_a_reason() -> None:
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
    assert "of the points, expected 10%" in scattered.reason


def test_points_on_a_line_give_no_plane() -> None:
    rng = np.random.default_rng(7)
    line = rng.normal([0.0, 1.5, 5.0], 0.002, (200, 3))
    line[:, 0] = np.linspace(-3, 3, 200)
    failure = fit_ground_plane(line)
    assert isinstance(failure, GroundPlaneFailure)
    assert failure.reason == "the ground points lie on one line"


@pytest.mark.parametrize("up", [[0, 0, 0], [0, 1], [0, np.nan, 1]])
def test_an_invalid_up_is_rejected(up: list[float]) -> None:
    points, _ = sloping_ground(40)
    with pytest.raises(InputError, match="expected a direction of three numbers"):
        fit_ground_plane(points, up=up)


def test_low_plants_are_not_the_ground() -> None:
    ground, normal = sloping_ground(1000, noise_m=0.01)
    cover = ground[450:] - [0.0, 0.35, 0.0]
    plane = fit_ground_plane(np.concatenate([ground[:450], cover]))
    assert isinstance(plane, GroundPlane)
    assert float(plane.normal @ normal) > 0.999
    assert abs(float(np.mean(plane.height_m(ground[:450])))) < 0.01


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_points_give_no_plane(count: int) -> None:
    failure = fit_ground_plane(np.ones((count, 3)))
    assert isinstance(failure, GroundPlaneFailure)
    assert failure.reason == f"{count} ground points, expected at least 12"


def test_several_places_are_fitted_independently() -> None:
    level = np.stack([*np.random.default_rng(1).uniform(-2, 2, (2, 90)), np.full(90, 1.4)], -1)
    sloping, _ = sloping_ground(90, noise_m=0.01)
    rubbish = np.full((90, 3), np.nan)
    sets = np.stack([sloping, level[:, [0, 2, 1]], rubbish])
    usable = np.isfinite(sets).all(2)
    usable[0, 60:] = False
    first, second, third = fit_ground_planes(sets, usable)
    assert isinstance(first, GroundPlane)
    assert isinstance(second, GroundPlane)
    assert isinstance(third, GroundPlaneFailure)
    assert third.reason == "0 ground points, expected at least 12"
    alone = [fit_ground_plane(sloping[:60]), fit_ground_plane(sets[1])]
    for plane, same in zip((first, second), alone, strict=True):
        assert isinstance(same, GroundPlane)
        assert plane.points == same.points
        np.testing.assert_allclose(plane.normal, same.normal, atol=1e-9)
        assert plane.offset_m == pytest.approx(same.offset_m)


def test_centre_and_extents_describe_the_points() -> None:
    points, normal = sloping_ground(400)
    plane = fit_ground_plane(points)
    assert isinstance(plane, GroundPlane)
    np.testing.assert_allclose(plane.centre_m, points.mean(0))
    np.testing.assert_allclose(plane.axes @ plane.axes.T, np.eye(2), atol=1e-9)
    np.testing.assert_allclose(plane.axes @ normal, 0.0, atol=1e-9)
    spread = ((points - points.mean(0)) @ plane.axes.T).std(0)
    np.testing.assert_allclose(plane.extents_m, spread)


def test_height_and_tilt_errors_match_their_standard_deviations() -> None:
    rng = np.random.default_rng(9)
    # Four neighbours share one error.
    x, z, noise_m = rng.standard_normal((3, 300, 15)).repeat(4, 2)
    x, z, noise_m = 0.5 * x + rng.normal(0, 0.01, x.shape), 4 + 0.5 * z, 0.02 * noise_m
    sets = np.stack([x, 1.5 + noise_m, z], -1)
    planes = fit_ground_planes(
        sets, np.ones((300, 60), np.bool_), tolerance_m=0.2, points_per_error=4.0
    )
    near, far = [0.0, 1.5, 4.0], [0.0, 1.5, 8.0]
    heights, stds = [], []
    for plane in planes:
        assert isinstance(plane, GroundPlane)
        assert plane.independent_points == pytest.approx(plane.points / 4)
        heights.append(plane.height_m([near, far]))
        stds.append(plane.height_std_m([near, far]))
    ratio = np.std(heights, axis=0) / np.mean(stds, axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.25)
    assert np.mean(stds, axis=0)[1] > 3 * np.mean(stds, axis=0)[0]


def around_a_stem(count: int = 400) -> tuple[Float, Float]:
    """(1, N, 3) points of level ground within 1.4 m of (0, 1.5, 4), and the distances (1, N)."""
    rng = np.random.default_rng(6)
    away_m, turn = 1.4 * np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
    x, z = away_m * np.cos(turn), away_m * np.sin(turn)
    return np.stack([x, np.full(count, 1.5), z + 4], -1)[None], away_m[None]


@pytest.mark.parametrize("bend_per_m", [0.06, -0.06])
def test_ground_that_bends_away_is_fitted_in_the_middle(bend_per_m: float) -> None:
    points, away_m = around_a_stem()
    points[..., 1] -= bend_per_m * away_m**2
    usable, middle = np.ones(away_m.shape, np.bool_), [0.0, 1.5, 4.0]
    heights_m = []
    for departure_per_m in (0.0, 0.15):
        [plane] = fit_ground_planes(points, usable, departure_std_m=departure_per_m * away_m**2)
        assert isinstance(plane, GroundPlane)
        heights_m.append(abs(float(plane.height_m(middle))))
    assert heights_m[1] < 0.018
    assert heights_m[0] > 0.025


def test_low_plants_away_from_the_middle_are_no_ground_that_bends() -> None:
    points, away_m = around_a_stem()
    plants = (away_m > 0.5) & (np.arange(away_m.shape[1]) % 2 == 0)
    points[..., 1] -= np.where(plants, 0.12, 0.0)
    [plane] = fit_ground_planes(
        points, np.ones(away_m.shape, np.bool_), departure_std_m=0.15 * away_m**2
    )
    assert isinstance(plane, GroundPlane)
    assert plane.above_fraction > 0.8 * plants.mean()
    assert float(plane.height_m([0.0, 1.5, 4.0])) == pytest.approx(0.0, abs=0.005)
