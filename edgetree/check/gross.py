"""Readings that belong to no error of measurement: mistyped, swapped, or of another stem."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from basetree.arrays import Bool, Float
from basetree.normal import MAD_TO_STD
from edgetree.check.comparison import Comparison

_GROSS: Final = math.log(1.5)  # a smaller disagreement may be an error of measurement
_FAR_STDS, _NEAR_STDS, _SWAP_STDS = 6.0, 3.0, 4.0
_FEWEST: Final = 4  # stems whose median is a centre
_POWERS: Final = {10: "ten", 100: "a hundred", 1000: "a thousand"}
_FEWEST_ROWS: Final = 6  # of a table whose shift is looked for
_SHIFT_GAIN: Final = 3.0
_UNRELATED: Final = 0.1  # median disagreement of readings that may belong to other stems


@dataclass(frozen=True)
class GrossError:
    """A comparison that is left out.

    Attributes:
        comparison: The values.
        cause: The likely cause, in words.
        mistyped: Whether the caliper's table explains it: a wrong power of ten, or two readings
            swapped. Otherwise it may be the machine's fault, and counts as a value outside of its
            95 % interval.
    """

    comparison: Comparison
    cause: str
    mistyped: bool


def find_gross_errors(comparisons: Sequence[Comparison]) -> list[GrossError]:
    """The gross errors among diameters of different stems, in their order.

    Each logarithm of measured / caliper is compared with the median of all and with the robust
    spread (median absolute deviation) or the stated errors, whichever is larger. The diameters are
    positive.
    """
    measured, caliper, stated = (
        np.array(values)
        for values in zip(
            *(
                (each.measured.value, each.caliper.value, each.error.std / each.caliper.value)
                for each in comparisons
            ),
            strict=True,
        )
    )
    ratio = np.log(np.maximum(measured, 1e-9) / caliper)
    centre = float(np.median(ratio)) if len(ratio) >= _FEWEST else 0.0
    off = ratio - centre
    spread = max(MAD_TO_STD * float(np.median(np.abs(off))), float(np.median(stated)))
    swapped = _swaps(off, np.log(caliper), _SWAP_STDS * spread, _NEAR_STDS * spread)
    found = []
    for index, each in enumerate(comparisons):
        power = _power_of_ten(float(off[index]))
        if index in swapped:
            other = comparisons[swapped[index]].pair.caliper.name
            found.append(GrossError(each, f"swapped with the reading of {other}?", True))
        elif power:
            found.append(GrossError(each, power, True))
        elif len(ratio) >= _FEWEST and abs(off[index]) > max(_FAR_STDS * spread, _GROSS):
            circumference = abs(off[index] + math.log(math.pi)) < _NEAR_STDS * spread
            cause = "a circumference?" if circumference else "another stem, or mistyped?"
            found.append(GrossError(each, cause, False))
    return found


def _power_of_ten(off: float) -> str:
    """In words, how a reading was mistyped; empty if it is not."""
    for power, word in _POWERS.items():
        if abs(abs(off) - math.log(power)) < _GROSS:
            return f"typed {word} times too {'small' if off > 0 else 'large'} (decimal comma?)"
    return ""


def _swaps(off: Float, log_caliper: Float, far: float, near: float) -> dict[int, int]:
    """Pairs of stems whose readings fit when they are exchanged, each in both directions."""
    found: dict[int, int] = {}
    doubtful = [int(index) for index in np.flatnonzero(np.abs(off) > far)]
    for place, one in enumerate(doubtful):
        for other in doubtful[place + 1 :]:
            change = log_caliper[one] - log_caliper[other]
            fits: Bool = np.abs([off[one] + change, off[other] - change]) < near
            if fits.all() and one not in found and other not in found:
                found |= {one: other, other: one}
    return found


def shifted_rows(comparisons: Sequence[Comparison]) -> int:
    """By how many rows the readings must be moved to fit: 1 down, -1 up, 0 if they are in place."""
    if len(comparisons) < _FEWEST_ROWS:
        return 0
    measured = np.log([max(each.measured.value, 1e-9) for each in comparisons])
    caliper = np.log([each.caliper.value for each in comparisons])
    spreads = {
        0: _mad(measured - caliper),
        1: _mad(measured[1:] - caliper[:-1]),
        -1: _mad(measured[:-1] - caliper[1:]),
    }
    best = min(spreads, key=lambda rows: spreads[rows])
    moved = spreads[0] > _UNRELATED and _SHIFT_GAIN * spreads[best] < spreads[0]
    return best if moved else 0


def _mad(values: Float) -> float:
    return float(np.median(np.abs(values - np.median(values))))
