"""The field's acceptance test: compare a machine's table with that of a caliper."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from basetree.errors import InputError
from edgetree.check.error_fit import ErrorFit, fit_errors
from edgetree.check.matching import Matching, match_stems
from edgetree.check.quantities import QuantityCheck, check_quantity
from edgetree.check.records import (
    fit_record,
    matching_record,
    quantity_record,
    verdict_record,
)
from edgetree.check.stems import CHECKED, CaliperTable, MeasuredTable
from edgetree.check.verdict import Verdict, judge, missed_stems
from edgetree.measure import Failure, MeasureSettings

MAX_DISTANCE_M: Final = 0.5
"""Default of the largest distance between two positions of one stem, in metres."""


@dataclass(frozen=True)
class CheckResult:
    """The comparison of two tables.

    Attributes:
        matching: Which stems are the same.
        max_distance_m: Largest distance between two positions of one stem.
        quantities: The compared quantities, by their keys in `TreeMeasurement`.
        not_compared: Why a quantity of the caliper's table could not be compared, by quantity.
        verdict: Whether the machine passes.
        fit: The fit of the stated errors, or why there is none.
    """

    matching: Matching
    max_distance_m: float
    quantities: dict[str, QuantityCheck]
    not_compared: dict[str, str]
    verdict: Verdict
    fit: ErrorFit | Failure

    @property
    def passed(self) -> bool:
        """Whether the check passes: it neither fails nor is undecided."""
        return self.verdict.outcome == "passed"

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary. Lengths are in metres, shares between 0 and 1."""
        fit = self.fit
        return {
            **matching_record(self.matching),
            "max_distance_m": None if self.matching.by == "number" else self.max_distance_m,
            "quantities": {name: quantity_record(each) for name, each in self.quantities.items()},
            "not_compared": self.not_compared,
            "fit": None if isinstance(fit, Failure) else fit_record(fit),
            "fit_failure": fit.reason if isinstance(fit, Failure) else None,
            **verdict_record(self.verdict),
        }


def compare(
    measured: MeasuredTable,
    caliper: CaliperTable,
    *,
    max_distance_m: float = MAX_DISTANCE_M,
    settings: MeasureSettings | None = None,
) -> CheckResult:
    """Compare a machine's table with a caliper's.

    Args:
        measured: The machine's table.
        caliper: The caliper's table.
        max_distance_m: Largest distance between two positions of one stem, in metres. Not used
            for stems with numbers.
        settings: The settings that the machine measured with.

    Raises:
        InputError: The stems cannot be matched (see `match_stems`), no matched stem has a measured
            diameter, or `max_distance_m` is not positive.
    """
    if not (math.isfinite(max_distance_m) and max_distance_m > 0):
        raise InputError(f"max_distance_m is {max_distance_m}: expected metres above 0")
    matching = match_stems(measured, caliper, max_distance_m)
    if not matching.pairs:
        raise InputError(
            f"{caliper.source}: all matches with {measured.source} are ambiguous, the first:"
            f" {matching.ambiguous[0].caliper.name}: expected tree numbers or more accurate"
            " positions"
        )
    results = {quantity: check_quantity(quantity, matching.pairs) for quantity in CHECKED}
    quantities = {name: each for name, each in results.items() if isinstance(each, QuantityCheck)}
    if "diameter_m" not in quantities and "dbh_m" not in quantities:
        reasons = [
            f"{name}: {each.reason}"
            for name, each in results.items()
            if isinstance(each, Failure) and _was_read(name, caliper)
        ]
        raise InputError(
            f"{measured.source}: expected a measured diameter for a stem of {caliper.source},"
            f" found none ({'; '.join(reasons)})"
        )
    verdict = judge(quantities, missed_stems(matching))
    return CheckResult(
        matching=matching,
        max_distance_m=max_distance_m,
        quantities=quantities,
        not_compared={
            name: each.reason
            for name, each in results.items()
            if isinstance(each, Failure) and _was_read(name, caliper)
        },
        verdict=verdict,
        fit=_fit(quantities.get("diameter_m"), verdict, settings),
    )


def _fit(
    diameter: QuantityCheck | None, verdict: Verdict, settings: MeasureSettings | None
) -> ErrorFit | Failure:
    if diameter is None:
        return Failure("no diameter at the cut to fit the stated errors to")
    if verdict.doubts:
        return Failure(verdict.doubts[0])
    return fit_errors(diameter.comparisons, settings)


def _was_read(quantity: str, caliper: CaliperTable) -> bool:
    return any(quantity in stem.values for stem in caliper.stems)
