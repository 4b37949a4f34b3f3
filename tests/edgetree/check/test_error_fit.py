"""The fit of the stated errors, on tables with a known scale and known errors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from edgetree import TreeDetector, default_model, sample_frames
from edgetree.check import CaliperTable, ErrorFit, MeasuredTable, compare
from edgetree.measure import Estimate, Failure, MeasureSettings, measure_trees

Tables = Callable[..., tuple[MeasuredTable, CaliperTable]]


def fitted(tables: tuple[MeasuredTable, CaliperTable]) -> ErrorFit:
    fit = compare(*tables).fit
    assert isinstance(fit, ErrorFit)
    return fit


def test_a_known_scale_and_factor_are_found(simulated: Tables) -> None:
    fit = fitted(simulated(2000, scale=1.04, factor=1.5))
    assert fit.scale.value == pytest.approx(1.04, abs=0.003)
    assert fit.factor.value == pytest.approx(1.5, rel=0.05)
    assert fit.scale_significant
    assert fit.factor_significant
    assert fit.coverage_before.value < 0.65
    assert fit.coverage_after.value == pytest.approx(0.95, abs=0.012)
    for name in ("keypoint_spread", "out_of_round_std", "readings_doubt"):
        expected = getattr(MeasureSettings(), name) * fit.factor.value
        assert fit.settings[name] == pytest.approx(expected, rel=1e-3)
    MeasureSettings(**fit.settings)


def test_the_stated_uncertainties_of_the_fit_hold(simulated: Tables) -> None:
    fits = [fitted(simulated(40, factor=1.5, seed=seed)) for seed in range(60)]
    for name, truth in (("scale", 1.0), ("factor", 1.5)):
        values = np.array([getattr(fit, name) for fit in fits])
        assert values[:, 0].mean() == pytest.approx(truth, abs=3 * values[:, 0].std() / 60**0.5)
        assert values[:, 1].mean() == pytest.approx(values[:, 0].std(), rel=0.3)


@pytest.mark.parametrize("of_measured", [True, False])
def test_errors_that_are_shares_of_the_measured_diameter_make_no_scale(
    tables: Tables, of_measured: bool
) -> None:
    """As without depth, where a wrong distance makes diameter and stated error wrong alike."""
    fits = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        true_m = rng.uniform(0.15, 0.6, 300)
        measured_m = true_m * (1 + 0.12 * rng.normal(size=300))
        std_m = 0.12 * (measured_m if of_measured else true_m)
        fits.append(fitted(tables(true_m, measured_m, std_m)))
    off = np.array([(fit.scale.value - 1) / fit.scale.std for fit in fits])
    assert abs(off.mean()) < 3 / len(fits) ** 0.5
    assert not any(fit.scale_significant for fit in fits)
    assert np.mean([fit.factor.value for fit in fits]) == pytest.approx(1.0, abs=0.05)


def test_a_good_machine_keeps_its_settings(simulated: Tables) -> None:
    fits = [fitted(simulated(30, seed=seed)) for seed in range(40)]
    assert sum(fit.scale_significant for fit in fits) <= 1
    assert sum(bool(fit.settings) for fit in fits) <= 5
    kept = next(fit for fit in fits if not (fit.scale_significant or fit.factor_significant))
    assert kept.settings == {}
    # The judgement of each stem uses fits to the others, which may find a factor by chance.
    assert abs(kept.coverage_after.count - kept.coverage_before.count) <= 2


def test_intervals_that_are_too_wide_are_narrowed(simulated: Tables) -> None:
    fit = fitted(simulated(200, factor=0.5))
    assert fit.factor.value == pytest.approx(0.5, rel=0.15)
    assert fit.settings["mask_spread"] < MeasureSettings().mask_spread
    assert fit.coverage_before.value > fit.coverage_after.value > 0.9


def test_one_wrong_reading_does_not_change_the_settings(simulated: Tables, tables: Tables) -> None:
    measured, caliper = simulated(25)
    before = fitted((measured, caliper))
    wrong = caliper.stems[3]
    wrong.values["diameter_m"] = Estimate(3 * wrong.values["diameter_m"].value, 0.0)  # type: ignore[index]
    after = fitted((measured, caliper))
    assert after.settings == before.settings == {}
    assert after.factor.value < 1.35 * before.factor.value
    assert not after.scale_significant


def test_the_calipers_own_error_is_not_blamed_on_the_machine(simulated: Tables) -> None:
    fit = fitted(simulated(1000, factor=1.0, caliper_std_m=0.01))
    assert fit.factor.value == pytest.approx(1.0, abs=0.1)
    hidden = compare(*simulated(40, factor=0.3, seed=1, caliper_std_m=0.02)).fit
    assert isinstance(hidden, Failure)
    assert "is too uncertain: measure more stems" in hidden.reason
    exact = compare(*simulated(30, factor=1e-6)).fit
    assert exact == Failure("the differences are too small to fit the stated errors to")


def test_fewer_than_twenty_stems_are_refused(simulated: Tables) -> None:
    assert compare(*simulated(19)).fit == Failure(
        "a fit needs 20 stems with a measured diameter, there are 19"
    )
    assert isinstance(compare(*simulated(20)).fit, ErrorFit)


def test_the_settings_are_relative_to_those_measured_with(simulated: Tables) -> None:
    used = MeasureSettings(mask_spread=0.9)
    fit = compare(*simulated(100, factor=2.0), settings=used).fit
    assert isinstance(fit, ErrorFit)
    assert fit.settings["mask_spread"] == pytest.approx(0.9 * fit.factor.value, rel=1e-3)


def test_the_new_settings_multiply_the_measured_errors_by_the_factor(simulated: Tables) -> None:
    fit = fitted(simulated(200, factor=1.5))
    settings = MeasureSettings(**fit.settings)
    detector = TreeDetector.load(default_model("depth"), threads=1)
    ratios, shifts = [], []
    for frame in sample_frames():
        depth_m = frame.depth_m()
        trees = detector.detect(depth_m)
        pairs = zip(
            *(
                measure_trees(
                    trees, depth_m, frame.camera, up_camera=frame.up_camera, settings=each
                )
                for each in (None, settings)
            ),
            strict=True,
        )
        for before, after in ((a.diameter_m, b.diameter_m) for a, b in pairs):
            if before and after:
                ratios.append(after.std / before.std)
                shifts.append(abs(after.value - before.value) / before.std)
    assert len(ratios) >= 15
    assert np.median(ratios) == pytest.approx(fit.factor.value, rel=0.06)
    assert np.median(shifts) < 0.1
