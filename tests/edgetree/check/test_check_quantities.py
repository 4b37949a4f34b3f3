"""Bias, scatter, coverage and the criteria of the check, against numbers worked out by hand."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from basetree.errors import InputError
from edgetree.check import CaliperTable, MeasuredTable, Share, compare
from edgetree.measure import Failure

Tables = Callable[..., tuple[MeasuredTable, CaliperTable]]


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    # The second and third rows are the examples of Newcombe (1998), table I, method 3.
    [(0, 10, 0.0, 0.2775), (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (5, 5, 0.5655, 1)],
)
def test_wilson_interval(count: int, total: int, low: float, high: float) -> None:
    share = Share(count, total)
    assert share.value == count / total
    assert share.interval95 == pytest.approx((low, high), abs=1e-4)


def test_the_numbers_of_four_stems(tables: Tables) -> None:
    caliper, errors = np.array([0.2, 0.3, 0.4, 0.5]), np.array([0.01, -0.02, 0.03, 0.04])
    result = compare(*tables(caliper, caliper + errors, [0.01, 0.01, 0.02, 0.01]))
    check = result.quantities["diameter_m"]
    assert check.mean_m == pytest.approx(0.35)
    assert check.bias_m == pytest.approx(0.015)
    # Sum of squared deviations 0.0007 + 0.0014 = 0.0021, divided by 3 and by 4.
    assert check.bias_std_m == pytest.approx(math.sqrt(0.0021 / 12))
    assert check.rmse_m == pytest.approx(math.sqrt(0.003 / 4))
    assert check.rmse_share == pytest.approx(math.sqrt(0.003 / 4) / 0.35)
    assert check.median_abs_error_m == pytest.approx(0.025)
    # Standardised errors: 1, -2, 1.5, 4.
    assert (check.coverage.count, check.coverage.total) == (2, 4)
    assert check.mean_squared_standardised_error == pytest.approx((1 + 4 + 2.25 + 16) / 4)
    assert [each.pair.measured.tree for each in check.outliers] == [3]


def test_errors_of_the_caliper_count(tables: Tables) -> None:
    result = compare(*tables([0.3, 0.3], [0.328, 0.3], [0.006, 0.006], caliper_std_m=0.008))
    check = result.quantities["diameter_m"]
    assert [each.error.std for each in check.comparisons] == pytest.approx([0.01, 0.01])
    assert check.mean_squared_standardised_error == pytest.approx(2.8**2 / 2)
    assert check.outliers == []


def test_an_unbiased_machine_with_right_errors_passes(simulated: Tables) -> None:
    check = (result := compare(*simulated(400))).quantities["diameter_m"]
    assert result.passed
    assert check.coverage.value == pytest.approx(0.95, abs=0.025)
    assert check.mean_squared_standardised_error == pytest.approx(1.0, abs=0.2)


def test_errors_that_are_too_small_fail(simulated: Tables) -> None:
    result = compare(*simulated(60, factor=2.0))
    (problem,) = result.verdict.problems
    assert "the 95 % intervals hold" in problem
    assert "of 60 values, clearly less than 95 %" in problem


def test_low_coverage_of_few_stems_does_not_fail(tables: Tables) -> None:
    # Of 5 right intervals, one or more err in 23 of 100 cases, three or more in 0.1.
    one = compare(*tables([0.3] * 5, [0.3, 0.3, 0.3, 0.3, 0.34], [0.01] * 5))
    assert one.verdict.outcome == "undecided"
    three = compare(*tables([0.3] * 5, [0.3, 0.3, 0.34, 0.34, 0.34], [0.01] * 5))
    assert three.verdict.outcome == "failed"


@pytest.mark.parametrize(
    ("bias", "scatter", "outcome"),
    [
        (0.03, 0.01, "failed"),
        (-0.03, 0.01, "failed"),
        (0.015, 0.01, "passed"),
        (0.03, 0.08, "undecided"),
    ],
)
def test_a_bias_fails_if_it_is_certain_and_large(
    tables: Tables, bias: float, scatter: float, outcome: str
) -> None:
    errors = 0.3 * (bias + scatter * np.array([1, -1] * 8))
    verdict = compare(*tables([0.3] * 16, 0.3 + errors, [max(scatter, 0.02)] * 16)).verdict
    assert verdict.outcome == outcome
    if outcome == "failed":
        assert f"the bias of {bias * 100:+.1f} %" in verdict.problems[0]


def test_one_stem_has_no_standard_error(tables: Tables) -> None:
    result = compare(*tables([0.3], [0.31], [0.01]))
    assert result.quantities["diameter_m"].bias_std_m is None
    assert isinstance(result.fit, Failure)


def test_stems_without_a_value_are_named_and_do_not_count(tables: Tables) -> None:
    measured, caliper = tables([0.3, 0.4], [0.31, 0.41], [0.01, 0.01])
    measured.stems[1].values["diameter_m"] = Failure("no depth on the stem")  # type: ignore[index]
    check = compare(measured, caliper).quantities["diameter_m"]
    assert len(check.comparisons) == 1
    assert [(each.pair.measured.tree, each.reason) for each in check.not_measured] == [
        (1, "no depth on the stem")
    ]
    measured.stems[0].values["diameter_m"] = Failure("no depth on the stem")  # type: ignore[index]
    with pytest.raises(InputError, match=r"not measured on any of 2 stems, the first: no depth"):
        compare(measured, caliper)


def test_a_limit_that_is_not_positive_is_refused(tables: Tables) -> None:
    with pytest.raises(InputError, match="max_distance_m is 0"):
        compare(*tables([0.3], [0.3], [0.01]), max_distance_m=0)


def test_the_record_is_json(simulated: Tables) -> None:
    record: dict[str, Any] = json.loads(
        json.dumps(compare(*simulated(30)).to_dict(), allow_nan=False)
    )
    diameter = record["quantities"]["diameter_m"]
    assert (record["matched"], diameter["stems"], diameter["coverage"]["total"]) == (30, 30, 30)
    assert record["fit"]["coverage_after"]["total"] == 30
    assert record["max_distance_m"] is None
