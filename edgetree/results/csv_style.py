"""How CSV tables are written: for programs, or for spreadsheets with decimal commas."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, TextIO

from edgetree.results.csv_cells import text_cell

_DIGITS: Final = 5
# Decimals of figures without a stated error, by the unit at the end of the column's name.
_DECIMALS: Final = {"m": 3, "m3": 4, "px": 1, "deg": 1, "s": 3}
_DECIMALS_OF_SHARES: Final = 2
_BYTE_ORDER_MARK: Final = "\ufeff"  # by which Excel knows UTF-8


@dataclass(frozen=True)
class CsvStyle:
    """How a table is written.

    Attributes:
        is_for_excel: Whether with a byte order mark, semicolons, decimal commas, and figures that
            are rounded to the second digit of their standard deviation.
        all_columns: Whether with all columns, in place of the short table.
    """

    is_for_excel: bool = False
    all_columns: bool = True

    def write_header(
        self, stream: TextIO, columns: Sequence[str], short: Sequence[str] = ()
    ) -> None:
        """Write the column names.

        Args:
            stream: Opened with `newline=""`, at its beginning.
            columns: All columns.
            short: Those of the short table; all if empty.
        """
        if self.is_for_excel:
            stream.write(_BYTE_ORDER_MARK)
        self._writer(stream).writerow(self._written(columns, short))

    def write_rows(
        self,
        stream: TextIO,
        columns: Sequence[str],
        short: Sequence[str],
        rows: Iterable[Mapping[str, object]],
    ) -> None:
        """Write rows of values by column; cells without a value are empty."""
        writer, written = self._writer(stream), self._written(columns, short)
        stds = _std_columns(tuple(columns)) if self.is_for_excel else {}
        for row in rows:
            writer.writerow([self._cell(row, name, stds) for name in written])

    def _cell(self, row: Mapping[str, object], name: str, stds: Mapping[str, str]) -> object:
        value = row.get(name, "")
        if self.is_for_excel and isinstance(value, float):
            return _figure(value, name, row.get(stds.get(name, "")))
        return cell(value)

    def _written(self, columns: Sequence[str], short: Sequence[str]) -> Sequence[str]:
        return columns if self.all_columns or not short else short

    def _writer(self, stream: TextIO) -> Any:
        return csv.writer(stream, delimiter=";" if self.is_for_excel else ",")


PLAIN: Final = CsvStyle()
"""For programs: commas, decimal points, five decimals, all columns."""

EXCEL: Final = CsvStyle(is_for_excel=True, all_columns=False)
"""For spreadsheets of countries with decimal commas: the short table."""


def cell(value: object) -> object:
    """A value for a cell.

    Numbers are rounded to five digits. Text is put on one line, and escaped where a spreadsheet
    would take it for a formula, see `text_cell`.
    """
    if isinstance(value, float):
        return round(value, _DIGITS)
    if isinstance(value, Iterable) and not isinstance(value, str):
        value = "; ".join(map(str, value))
    return text_cell(value) if isinstance(value, str) else value


def _figure(value: float, name: str, std: object) -> str:
    """A figure with a decimal comma, rounded to the second digit of its standard deviation."""
    if isinstance(std, float) and 0 < std < math.inf:
        decimals = 1 - math.floor(math.log10(std))
    else:
        decimals = _DECIMALS.get(name.rpartition("_")[2], _DECIMALS_OF_SHARES)
    text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    return text.replace(".", ",")


@lru_cache
def _std_columns(columns: tuple[str, ...]) -> Mapping[str, str]:
    """The column of the standard deviation of each figure that has one.

    Its name is the figure's with `std` in place of a word, or between two: `diameter_std_m` of
    `diameter_m` and `diameter_low95_m`, `position_std_x_m` of `position_x_m`.
    """
    known = set(columns)
    found: dict[str, str] = {}
    for name in columns:
        words = name.split("_")
        for at in range(1, len(words)):
            for rest in (words[at:], words[at + 1 :]):
                std_name = "_".join((*words[:at], "std", *rest))
                if std_name in known:
                    found.setdefault(name, std_name)
    return found
