"""The verdict: its level, its power, and gross errors of the caliper's table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from edgetree.check import CaliperTable, MeasuredTable, Pair, compare
from edgetree.check.distributions import (
    at_least,
    exact_interval,
    fewest_unlikely,
    student_limit,
    t_test_power,
)
from edgetree.check.quantities import Share, check_quantity
from edgetree.check.verdict import judge
from edgetree.measure import Estimate, Failure

Tables = Callable[..., tuple[MeasuredTable, CaliperTable]]


def typed(table: CaliperTable, changes: dict[int, float]) -> CaliperTable:
    """The table with other readings, in metres, for some stems."""
    stems = list(table.stems)
    for number, value_m in changes.items():
        stems[number] = replace(stems[number], values={"diameter_m": Estimate(value_m, 0.0)})
    return CaliperTable(table.source, tuple(stems))


def read(table: CaliperTable, number: int) -> float:
    return table.stems[number].values["diameter_m"].value


def test_quantiles_and_tails_are_those_of_printed_tables() -> None:
    for level, dof, limit in ((0.05, 1, 12.706), (0.05, 4, 2.776), (0.01, 29, 2.756)):
        assert student_limit(level, dof) == pytest.approx(limit, rel=1e-3)
    assert student_limit(0.05, 20_000) == pytest.approx(1.960, abs=1e-3)
    assert at_least(2, 5, 0.5) == pytest.approx(26 / 32)
    assert [fewest_unlikely(5, 0.5, level) for level in (0.04, 0.02)] == [5, 6]
    assert exact_interval(3, 10) == pytest.approx((0.0667, 0.6525), abs=1e-4)
    assert exact_interval(0, 5) == pytest.approx((0, 0.5218), abs=1e-4)


def test_the_power_is_how_often_a_bias_is_found() -> None:
    rng = np.random.default_rng(2)
    for count in (4, 30):
        values = rng.normal(0.03, 0.05, (20_000, count))
        t = values.mean(1) / values.std(1, ddof=1) * count**0.5
        found = (np.abs(t) > student_limit(0.025, count - 1)) & (np.abs(values.mean(1)) > 0.02)
        power = t_test_power(0.03, 0.05, count, 0.025, 0.02)
        assert power == pytest.approx(found.mean(), abs=0.012)


@pytest.mark.parametrize("count", [3, 5, 30])
@pytest.mark.parametrize("heavy", [False, True])
def test_a_good_machine_fails_in_five_of_a_hundred_at_most(
    tables: Tables, count: int, heavy: bool
) -> None:
    rng = np.random.default_rng(1000 + count)
    failed = 0
    for _ in range(400):
        true_m = rng.uniform(0.15, 0.6, count)
        noise = rng.standard_t(4, count) / 2**0.5 if heavy else rng.normal(size=count)
        measured, caliper = tables(true_m, true_m * (1 + 0.05 * noise), 0.05 * true_m)
        check = check_quantity("diameter_m", tuple(map(Pair, measured.stems, caliper.stems)))
        assert not isinstance(check, Failure)
        failed += judge({"diameter_m": check}, Share(0, count)).outcome == "failed"
    assert failed <= 0.05 * 400 + 2.5 * (400 * 0.05 * 0.95) ** 0.5


def test_one_typing_error_hides_no_bias_and_no_factor(simulated: Tables) -> None:
    measured, caliper = simulated(30, scale=1.1, seed=1001)
    before = compare(measured, caliper)
    after = compare(measured, typed(caliper, {7: read(caliper, 7) / 10}))
    (gross,) = after.quantities["diameter_m"].gross_errors
    assert (gross.comparison.pair.measured.tree, gross.mistyped) == (7, True)
    assert gross.cause == "typed ten times too small (decimal comma?)"
    assert "the bias of" in after.verdict.problems[0]
    assert after.verdict.outcome == before.verdict.outcome == "failed"
    assert before.fit
    assert after.fit
    assert after.fit.factor.value == pytest.approx(before.fit.factor.value, rel=0.1)


def test_swapped_readings_are_named_and_left_out(tables: Tables) -> None:
    true_m = np.linspace(0.2, 0.5, 24)
    measured, caliper = tables(true_m, true_m * (1 + 0.02 * np.sin(np.arange(24))), 0.02 * true_m)
    assert compare(measured, caliper).quantities["diameter_m"].gross_errors == ()
    swapped = typed(caliper, {2: read(caliper, 20), 20: read(caliper, 2)})
    result = compare(measured, swapped)
    found = result.quantities["diameter_m"].gross_errors
    assert [each.cause for each in found] == [
        f"swapped with the reading of {swapped.stems[number].name}?" for number in (20, 2)
    ]
    assert result.passed


def test_an_error_without_explanation_counts_against_the_machine(simulated: Tables) -> None:
    measured, caliper = simulated(30, seed=1002)
    whole = compare(measured, caliper).quantities["diameter_m"]
    check = compare(measured, typed(caliper, {4: 2.2 * read(caliper, 4)})).quantities["diameter_m"]
    (gross,) = check.gross_errors
    assert not gross.mistyped
    assert check.coverage.total == 30
    assert check.coverage.count <= whole.coverage.count
    assert abs(check.bias_m) < 0.01


def test_many_wrong_readings_and_a_shifted_table_cannot_be_judged(simulated: Tables) -> None:
    measured, caliper = simulated(30, scale=1.1, seed=1003)
    many = {number: read(caliper, number) / 10 for number in range(4)}
    result = compare(measured, typed(caliper, many))
    assert result.verdict.outcome == "undecided"
    assert "4 of 30 readings look wrong" in result.verdict.reasons[0]
    assert isinstance(result.fit, Failure)
    moved = {number: read(caliper, number + 1) for number in range(29)}
    result = compare(measured, typed(caliper, moved))
    assert result.verdict.outcome == "undecided"
    assert "moved down by one row" in result.verdict.reasons[0]


def test_needless_width_fails_and_says_what_would_do(simulated: Tables) -> None:
    verdict = compare(*simulated(30, factor=0.1, seed=1004)).verdict
    assert "more than 2 times the true ones" in verdict.problems[0]
    assert compare(*simulated(30, factor=0.8, seed=1004)).passed


@pytest.mark.parametrize(("refused", "outcome"), [(3, "passed"), (18, "failed"), (27, "failed")])
def test_refused_and_missed_stems_count(simulated: Tables, refused: int, outcome: str) -> None:
    measured, caliper = simulated(30, seed=1005)
    stems = [
        replace(each, values={**each.values, "diameter_m": Failure("dark")})
        if each.tree < refused - 1
        else each
        for each in measured.stems[:-1]
    ]
    verdict = compare(MeasuredTable("trees.csv", tuple(stems)), caliper).verdict
    assert (verdict.missed.count, verdict.missed.total) == (refused, 30)
    assert verdict.outcome == outcome


def test_a_bias_that_grows_with_the_diameter_or_the_distance_fails(tables: Tables) -> None:
    rng = np.random.default_rng(1006)
    true_m, away_m = rng.uniform(0.15, 0.6, 40), rng.uniform(3, 15, 40)
    noise = 0.03 * rng.normal(size=40)
    for along, what in ((true_m, "diameter"), (away_m, "distance")):
        growing = 0.06 * (along - along.mean()) / along.std()
        measured, caliper = tables(true_m, true_m * (1 + growing + noise), 0.1 * true_m)
        stems = tuple(
            replace(each, point_camera_m=(0.0, 0.0, float(away)))
            for each, away in zip(measured.stems, away_m, strict=True)
        )
        verdict = compare(MeasuredTable("trees.csv", stems), caliper).verdict
        assert [f"the bias changes with the {what}" in each for each in verdict.problems] == [True]


def test_the_stems_that_are_needed_would_be_enough(simulated: Tables) -> None:
    power = compare(*simulated(8, seed=1007)).verdict.power["diameter_m"]
    assert not power.enough
    assert power.stems < power.needed < 60
    enough = compare(*simulated(power.needed + 10, seed=1007)).verdict.power["diameter_m"]
    assert enough.enough
