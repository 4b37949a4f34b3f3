"""Circles through slices of clouds, and diameters weighed with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from basetree.arrays import Float
from edgetree.measure import Estimate, Failure, MeasureSettings, StemProfile, TreeMeasurement
from edgetree.measure.circles import fit_circles
from edgetree.measure.estimates import StemAxis
from edgetree.measure.slices import with_circles

UP = np.array([0.0, -1.0, 0.0])
MIDDLE = np.array([0.4, 1.0, 6.0])
DIAMETER_M = 0.24


def stem_points(
    rng: np.random.Generator, arc_deg: float = 360.0, noise_m: float = 0.003, oval: float = 1.0
) -> Float:
    """(N, 3) points of a stem of 2 m around `MIDDLE`, as seen from the camera's side."""
    count = 6000
    turn = np.radians(rng.uniform(-arc_deg / 2, arc_deg / 2, count)) - np.pi / 2
    radius = DIAMETER_M / 2 + rng.normal(0, noise_m, count)
    x = np.cos(turn) * radius * np.sqrt(oval)
    z = np.sin(turn) * radius / np.sqrt(oval)
    return MIDDLE + np.stack([x, rng.uniform(-1, 1, count), z], -1)


def branches(rng: np.random.Generator) -> Float:
    """(N, 3) points of two branches that leave the stem at `MIDDLE`."""
    length = rng.uniform(0.12, 0.5, 400)
    side = np.stack([length, rng.normal(0, 0.01, 400), rng.normal(0, 0.01, 400)], -1)
    return np.concatenate([MIDDLE + side, MIDDLE - side])


def fitted(points: Float, off_m: float = 0.03) -> tuple[float, float]:
    centre = MIDDLE + np.array([off_m, 0, off_m])
    found = fit_circles(points, centre[None], UP, np.array([1.15 * DIAMETER_M]))
    return float(found.diameter_m[0]), float(found.std_m[0])


def test_a_stem_scanned_all_around_is_known_to_millimetres_in_spite_of_branches() -> None:
    rng = np.random.default_rng(0)
    diameter_m, std_m = fitted(np.concatenate([stem_points(rng), branches(rng)]))

    assert diameter_m == pytest.approx(DIAMETER_M, abs=0.004)
    assert std_m < 0.006


@pytest.mark.parametrize("arc_deg", [110.0, 160.0, 360.0])
def test_nearly_all_diameters_are_within_their_intervals(arc_deg: float) -> None:
    inside = []
    for seed in range(1000, 1040):
        rng = np.random.default_rng(seed)
        oval = 1 + abs(rng.normal(0, 0.06))
        diameter_m, std_m = fitted(stem_points(rng, arc_deg, rng.uniform(0.002, 0.015), oval))
        inside.append(abs(diameter_m - DIAMETER_M) < 1.96 * std_m)

    assert np.mean(inside) >= 0.93


def test_the_deviation_grows_as_less_of_the_stem_is_seen() -> None:
    stds = [fitted(stem_points(np.random.default_rng(1), arc))[1] for arc in (360, 180, 110)]

    assert stds[0] < stds[1] < stds[2]


def test_no_circle_is_fitted_to_too_few_points_or_too_little_of_a_stem() -> None:
    rng = np.random.default_rng(2)

    assert not np.isfinite(fitted(stem_points(rng)[:40])[1])
    assert not np.isfinite(fitted(stem_points(rng, 60.0))[1])
    assert not np.isfinite(fitted(np.zeros((0, 3)))[1])


def measured(diameter_m: float, std_m: float) -> TreeMeasurement:
    heights = np.array([1.0, 1.3, 1.6])
    middles = MIDDLE + (heights[:, None] - 1.3) * UP
    side = np.array([diameter_m / 2, 0, 0])
    profile = StemProfile(
        heights_from="ground",
        height_m=heights,
        diameter_m=np.full(3, diameter_m),
        diameter_std_m=np.full(3, std_m),
        edges_m=np.stack([middles - side, middles + side], 1),
    )
    return replace(
        TreeMeasurement.failed("not measured"),
        diameter_m=Estimate(diameter_m, std_m),
        dbh_m=Estimate(diameter_m, std_m),
        section_m=Estimate(diameter_m, std_m),
        profile=profile,
        axis=StemAxis(
            point_m=MIDDLE,
            point_covariance_m2=np.eye(3) * 1e-4,
            direction=UP,
            direction_covariance=np.eye(3) * 1e-4,
        ),
    )


def test_diameters_are_weighed_with_circles_and_the_evidence_says_so() -> None:
    points = stem_points(np.random.default_rng(3))
    [tree] = with_circles([measured(0.26, 0.015)], points, MeasureSettings(species="pine"))

    assert isinstance(tree.profile, StemProfile)
    for estimate in (tree.diameter_m, tree.dbh_m):
        assert isinstance(estimate, Estimate)
        assert estimate.value == pytest.approx(DIAMETER_M, abs=0.005)
        assert estimate.std < 0.015
    np.testing.assert_allclose(tree.profile.diameter_m, DIAMETER_M, atol=0.005)
    assert "circle" in tree.evidence.source_diameters_m
    assert "circle" in tree.evidence.method
    assert tree.volume_m3
    assert not tree.evidence.warnings


def test_an_outline_that_contradicts_the_circle_gives_a_warning_and_a_larger_deviation() -> None:
    points = stem_points(np.random.default_rng(4))
    [agreeing] = with_circles([measured(0.245, 0.008)], points, MeasureSettings())
    [tree] = with_circles([measured(0.34, 0.008)], points, MeasureSettings())

    assert any("breast height" in warning for warning in tree.evidence.warnings)
    assert isinstance(tree.dbh_m, Estimate)
    assert isinstance(agreeing.dbh_m, Estimate)
    assert tree.dbh_m.std > 5 * agreeing.dbh_m.std


def test_a_thin_cloud_and_a_failed_stem_change_nothing() -> None:
    tree = measured(0.26, 0.015)
    failed = TreeMeasurement.failed("no depth on the stem")
    thin, still_failed = with_circles([tree, failed], MIDDLE[None], MeasureSettings())

    assert thin.to_dict() == tree.to_dict()
    assert still_failed.dbh_m == Failure("no depth on the stem")


def test_a_cut_that_is_inferred_keeps_the_doubt_of_its_butt() -> None:
    """The circle is that of the section above, not of the cut."""
    swollen = replace(measured(0.26, 0.015), diameter_m=Estimate(0.26 * 1.14, 0.026))

    [tree] = with_circles([swollen], stem_points(np.random.default_rng(3)), MeasureSettings())

    assert isinstance(tree.diameter_m, Estimate)
    assert tree.diameter_m.value == pytest.approx(1.14 * DIAMETER_M, abs=0.006)
    assert 0.018 < tree.diameter_m.std < 0.026


def test_a_diameter_of_another_part_stays_as_it_is() -> None:
    seen = replace(measured(0.26, 0.015), section_m=Failure("of another part"))

    [tree] = with_circles([seen], stem_points(np.random.default_rng(3)), MeasureSettings())

    assert tree.diameter_m == seen.diameter_m
    assert "circle" not in tree.evidence.method


def test_errors_of_the_rig_stay_in_what_is_weighed() -> None:
    """A scale that is wrong is wrong in the cloud as well."""
    rig_std = {"diameter_m": 0.013, "dbh_m": 0.013}
    tree = replace(measured(0.26, 0.015), rig_std=rig_std)

    [tree] = with_circles([tree], stem_points(np.random.default_rng(3)), MeasureSettings())

    assert isinstance(tree.profile, StemProfile)
    for estimate in (tree.diameter_m, tree.dbh_m):
        assert isinstance(estimate, Estimate)
        assert 0.013 < estimate.std < 0.015
    assert (tree.profile.diameter_std_m > 0.013 * 0.99).all()
