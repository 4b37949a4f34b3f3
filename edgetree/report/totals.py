"""What the trees of a report say together: means, basal area and volume, with their errors."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from html import escape
from typing import Final, NamedTuple

from basetree.counts import counted
from basetree.page import parts
from edgetree.measure import Estimate, Failure, TreeMeasurement
from edgetree.report.units import BASAL_AREA, UNITS, length_attributes

_MEANS: Final = {"diameter_m": "mean diameter at the felling cut", "dbh_m": "mean DBH"}


@dataclass
class _Sums:
    """Sums over the values of one quantity.

    The part of each error that the rig makes is the same in all trees: it is summed, and not its
    square.
    """

    number: int = 0
    value: float = 0.0
    variance: float = 0.0
    common: float = 0.0

    def add(self, value: float, std: float, common_std: float) -> None:
        """Add a value, its standard deviation, and the part of that which all values share."""
        common_std = min(common_std, std)
        self.number += 1
        self.value += value
        self.variance += std**2 - common_std**2
        self.common += common_std

    def sum(self) -> Estimate:
        """The sum with its standard deviation."""
        return Estimate(self.value, math.hypot(math.sqrt(self.variance), self.common))

    def mean(self) -> Estimate:
        """The mean with its standard deviation."""
        value, std = self.sum()
        return Estimate(value / self.number, std / self.number)


class _Value(NamedTuple):
    """A value, and the part of its standard deviation that it shares with all others."""

    estimate: Estimate
    common_std: float


@dataclass
class StandTotals:
    """Sums over the trees of a report, each of them once, with the most certain of its values.

    Attributes:
        area_ha: Area that the trees stand on, in hectares; None if it is not known.
    """

    area_ha: float | None = None
    _values: dict[str, dict[int, _Value]] = field(
        default_factory=lambda: {name: {} for name in (*_MEANS, "volume_m3")}
    )
    _reasons: dict[str, dict[int, str]] = field(
        default_factory=lambda: {name: {} for name in (*_MEANS, "volume_m3")}
    )
    _trees: set[int] = field(default_factory=set)

    def add(self, tree: TreeMeasurement, number: int) -> None:
        """Add a view of a tree.

        Args:
            tree: The measurement.
            number: The same for all views of a tree.
        """
        self._trees.add(number)
        for name, values in self._values.items():
            value = getattr(tree, name)
            if isinstance(value, Failure):
                self._reasons[name][number] = value.reason
            if isinstance(value, Estimate) and (
                number not in values or value.std < values[number].estimate.std
            ):
                # One volume function for all: its error, which is most of it, is the same in all.
                of_rig = tree.rig_std.get(name, 0.0)
                values[number] = _Value(value, value.std if name == "volume_m3" else of_rig)

    def values(self, quantity: str) -> list[float]:
        """The values of a quantity, one for each tree that has one."""
        return [each.estimate.value for each in self._values[quantity].values()]

    def html(self, counting: str) -> str:
        """The values as a section of the page; empty if there is none.

        Args:
            counting: How often a tree counts, in words.
        """
        rows = list(self._rows())
        if not rows:
            return ""
        words = (
            "± is one standard deviation of the measurement, with the rig's own errors, which do"
            f" not average away. Trees without a value are in none of these, and {counting}."
        )
        table = parts.table(["", "value", "trees with it"], rows, kind="text")
        return parts.heading("Totals", words) + table + parts.note(" ".join(self._missing()))

    def _missing(self) -> Iterator[str]:
        """What the totals lack, as sentences of HTML: sums of a part of the trees, and no sums."""
        sums = {"dbh_m": "basal area"} if self.area_ha is not None else {}
        for name, words in (sums | {"volume_m3": "sum of stem volumes"}).items():
            lacking = len(self._trees) - len(self._values[name])
            if lacking and self._values[name]:
                yield (
                    f"The {words} is of a part: {counted(lacking, 'tree')} without a value would"
                    f" come on top{self._why(name)}."
                )
        for name, words in {**_MEANS, "volume_m3": "sum of stem volumes"}.items():
            if not self._values[name]:
                yield f"There is no {words}{self._why(name)}."
        if self.area_ha is None:
            yield "There is no basal area: no --area is given."

    def _why(self, name: str) -> str:
        """The most frequent reason of the trees without a value; empty if none is known."""
        reasons = Counter(
            why for number, why in self._reasons[name].items() if number not in self._values[name]
        )
        if not reasons:
            return ""
        often = "mostly: " if len(reasons) > 1 else ""
        return f" ({often}{escape(reasons.most_common(1)[0][0])})"

    def _rows(self) -> Iterator[list[parts.Cell | str]]:
        for name, words in _MEANS.items():
            if self._values[name]:
                sums = self._sums(name)
                yield self._row(words, name, sums.mean(), sums)
        if self._values["dbh_m"]:
            yield from self._squares()
        if self._values["volume_m3"]:
            volumes = self._sums("volume_m3")
            yield self._row("sum of stem volumes", "volume_m3", volumes.sum(), volumes)

    def _sums(self, quantity: str) -> _Sums:
        sums = _Sums()
        for (value, std), common_std in self._values[quantity].values():
            sums.add(value, std, common_std)
        return sums

    def _squares(self) -> Iterator[list[parts.Cell | str]]:
        """Quadratic mean and basal area."""
        squares = _Sums()
        for (value, std), common_std in self._values["dbh_m"].values():
            slope = 2 * value
            squares.add(value**2, slope * std, slope * common_std)
        mean = squares.mean()
        root = math.sqrt(mean.value)
        yield self._row(
            "quadratic mean DBH", "dbh_m", Estimate(root, mean.std / (2 * root)), squares
        )
        if self.area_ha is not None:
            total, std = squares.sum()
            factor = math.pi / 4 / self.area_ha
            area = Estimate(factor * total, factor * std)
            yield self._row(f"basal area on {self.area_ha:g} ha", BASAL_AREA, area, squares)

    def _row(
        self, words: str, quantity: str, value: Estimate, sums: _Sums
    ) -> list[parts.Cell | str]:
        text = UNITS["cm"][quantity].with_std(value)
        cell = parts.Cell(text, length_attributes(quantity, value))
        return [words, cell, f"{sums.number} of {len(self._trees)}"]
