"""Tables of stems with known values."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from edgetree.check import CaliperStem, CaliperTable, MeasuredStem, MeasuredTable
from edgetree.measure import Estimate, Failure

Tables = tuple[MeasuredTable, CaliperTable]

NOTHING = {name: Failure("no ground") for name in ("diameter_m", "dbh_m", "cut_height_m")}


def diameter_tables(
    caliper_m: Sequence[float] | NDArray[np.floating],
    measured_m: Sequence[float] | NDArray[np.floating],
    std_m: Sequence[float] | NDArray[np.floating],
    caliper_std_m: float = 0.0,
) -> Tables:
    """Two tables of diameters, with stems of one frame and the same numbers."""
    measured = tuple(
        MeasuredStem("a", number, {**NOTHING, "diameter_m": Estimate(value, std)})
        for number, (value, std) in enumerate(zip(measured_m, std_m, strict=True))
    )
    caliper = tuple(
        CaliperStem(number + 2, {"diameter_m": Estimate(value, caliper_std_m)}, None, number)
        for number, value in enumerate(caliper_m)
    )
    return MeasuredTable("trees.csv", measured), CaliperTable("caliper.csv", caliper)


@pytest.fixture
def tables() -> Callable[..., Tables]:
    return diameter_tables


@pytest.fixture
def simulated() -> Callable[..., Tables]:
    """A function that simulates tables with a known scale and a known factor of the errors."""

    def simulate(
        count: int,
        scale: float = 1.0,
        factor: float = 1.0,
        seed: int = 0,
        caliper_std_m: float = 0.0,
    ) -> Tables:
        rng = np.random.default_rng(seed)
        true_m = rng.uniform(0.15, 0.6, count)
        std_m = true_m * rng.uniform(0.01, 0.05, count)
        measured_m = scale * true_m + factor * std_m * rng.normal(size=count)
        typed_m = true_m + caliper_std_m * rng.normal(size=count)
        return diameter_tables(typed_m, measured_m, std_m, caliper_std_m)

    return simulate
