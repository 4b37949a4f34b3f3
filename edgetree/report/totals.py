"""What the trees of a report say together: means, basal area and volume, with their errors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from basetree.page import parts
from edgetree.measure import Estimate, TreeMeasurement
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


@dataclass
class StandTotals:
    """Sums over the trees of a report.

    Attributes:
        area_ha: Area that the trees stand on, in hectares; None if it is not known.
    """

    area_ha: float | None = None
    _means: dict[str, _Sums] = field(default_factory=lambda: {name: _Sums() for name in _MEANS})
    _squares_m2: _Sums = field(default_factory=_Sums)
    _volumes_m3: _Sums = field(default_factory=_Sums)
    _trees: int = 0

    def add(self, tree: TreeMeasurement) -> None:
        """Add a tree."""
        self._trees += 1
        for name, sums in self._means.items():
            value = getattr(tree, name)
            if isinstance(value, Estimate):
                sums.add(value.value, value.std, tree.rig_std.get(name, 0.0))
        dbh, volume = tree.dbh_m, tree.volume_m3
        if isinstance(dbh, Estimate):
            slope = 2 * dbh.value
            common = slope * tree.rig_std.get("dbh_m", 0.0)
            self._squares_m2.add(dbh.value**2, slope * dbh.std, common)
        if isinstance(volume, Estimate):
            # One volume function for all: its error, which is most of it, is the same in all.
            self._volumes_m3.add(volume.value, volume.std, volume.std)

    def html(self) -> str:
        """The values as a section of the page; empty if there is none."""
        rows = list(self._rows())
        if not rows:
            return ""
        words = (
            "± is one standard deviation of the measurement, with the rig's own errors, which do"
            " not average away. Trees without a value are in none of these, and a tree counts as"
            " often as it is in a picture."
        )
        return parts.heading("Totals", words) + parts.table(
            ["", "value", "trees with it"], rows, kind="text"
        )

    def _rows(self) -> Iterator[list[parts.Cell | str]]:
        for name, words in _MEANS.items():
            if self._means[name].number:
                yield self._row(words, name, self._means[name].mean(), self._means[name])
        squares = self._squares_m2
        if squares.number:
            mean = squares.mean()
            root = math.sqrt(mean.value)
            value = Estimate(root, mean.std / (2 * root))
            yield self._row("quadratic mean DBH", "dbh_m", value, squares)
            if self.area_ha is not None:
                total, std = squares.sum()
                factor = math.pi / 4 / self.area_ha
                area = Estimate(factor * total, factor * std)
                yield self._row(f"basal area on {self.area_ha:g} ha", BASAL_AREA, area, squares)
        if self._volumes_m3.number:
            volumes = self._volumes_m3
            yield self._row("sum of stem volumes", "volume_m3", volumes.sum(), volumes)

    def _row(
        self, words: str, quantity: str, value: Estimate, sums: _Sums
    ) -> list[parts.Cell | str]:
        text = UNITS["cm"][quantity].with_std(value)
        cell = parts.Cell(text, length_attributes(quantity, value))
        return [words, cell, f"{sums.number} of {self._trees}"]
