"""Read CSV files as spreadsheets in different countries write them."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain, takewhile
from pathlib import Path
from typing import Final

from basetree.errors import InputError
from basetree.files.reading import read_text

_MOST_CELLS: Final = 2_000_000
_FEWEST_COLUMNS: Final = 8  # that a row counts as, since it takes memory itself
_LARGEST_NUMBER: Final = 1e9  # of any unit
_DELIMITERS: Final = (";", "\t", ",")
_END: Final = "\0"  # a last line that no text has; an open quote swallows it
_NUMBER: Final = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class Row:
    """One row of a CSV file.

    Attributes:
        place: File and line, for error messages.
        line: Number of the line in the file, from 1.
        cells: Text of each cell by column, without spaces around it.
    """

    place: str
    line: int
    cells: Mapping[str, str]

    def text(self, column: str) -> str:
        """The text of a cell; empty if there is no such column."""
        return self.cells.get(column, "")

    def number(self, column: str) -> float | None:
        """The number in a cell, with a decimal point or comma; None if the cell is empty.

        Raises:
            InputError: The cell holds something else.
        """
        text = self.text(column)
        if not text:
            return None
        value = float(text.replace(",", ".")) if _NUMBER.fullmatch(text) else float("inf")
        if abs(value) > _LARGEST_NUMBER:
            raise InputError(
                f"{self.place}: {column} is {text!r:.60}: expected a number, such as 31.4, of at"
                f" most {_LARGEST_NUMBER:g}"
            )
        return value

    def whole_number(self, column: str) -> int | None:
        """The whole number in a cell; None if the cell is empty.

        Raises:
            InputError: The cell holds something else.
        """
        value = self.number(column)
        if value is not None and value != int(value):
            raise InputError(
                f"{self.place}: {column} is {self.text(column)!r}: expected a whole number"
            )
        return None if value is None else int(value)


@dataclass(frozen=True)
class CsvFile:
    """The content of a CSV file.

    Attributes:
        path: The file.
        columns: Names of the columns, in lower case, with `_` for spaces and signs:
            "Diameter (cm)" becomes "diameter_cm".
        rows: The rows that are not empty.
    """

    path: Path
    columns: tuple[str, ...]
    rows: tuple[Row, ...]


def read_csv(path: Path, largest_bytes: int | None = None) -> CsvFile:
    """Read a CSV file.

    Args:
        path: The file.
        largest_bytes: Size of the largest file; `Limits.text_file_bytes` if None.

    The columns are separated by semicolons, tabs or commas: the first of these in the header.
    The encoding is UTF-8, UTF-16 with a byte order mark, or Windows-1252 if the file is not valid
    UTF-8. CRLF line ends and a first line such as "sep=;" are understood.

    Raises:
        InputError: The file cannot be read, is too large, has no header or no rows, a quote is not
            closed, or a row has more cells than the header.
    """
    lines = io.StringIO(_text(path, largest_bytes), newline="")
    header = lines.readline()
    skipped = 0
    if header.lower().startswith("sep="):
        header, skipped = lines.readline(), 1
    delimiter = next((each for each in _DELIMITERS if each in header), ",")
    reader = csv.reader(chain([header], lines, [_END]), delimiter=delimiter)
    rows: list[Row] = []
    begin = 1 + skipped
    try:
        columns = _columns(path, _closed(path, begin, next(reader)))
        begin = reader.line_num + skipped + 1
        for cells in takewhile(lambda cells: cells != [_END], reader):
            _closed(path, begin, cells)
            begin = reader.line_num + skipped + 1
            if any(cell.strip() for cell in cells):
                rows.append(_row(path, reader.line_num + skipped, columns, cells))
            if len(rows) * max(len(columns), _FEWEST_COLUMNS) > _MOST_CELLS:
                raise InputError(f"{path} has more than {_MOST_CELLS} cells: expected fewer")
    except csv.Error as error:
        raise InputError(
            f"{path}, line {reader.line_num + skipped}: {error}: expected a CSV table"
        ) from error
    if not rows:
        raise InputError(f"{path} has no rows: expected a header and a row for each stem")
    return CsvFile(path, tuple(name for name in columns if name), tuple(rows))


def _closed(path: Path, line: int, cells: list[str]) -> list[str]:
    """The cells of a row that begins in a line, which no open quote joins with all that follows."""
    if cells and cells != [_END] and cells[-1].endswith(_END):
        raise InputError(f"{path}, line {line}: a quote is not closed, expected its end")
    return cells


def _text(path: Path, largest_bytes: int | None) -> str:
    text = read_text(path, "a CSV file", largest_bytes)
    if "\0" in text:
        raise InputError(f"{path} is not a text file: expected CSV, in UTF-8")
    return text


def _columns(path: Path, cells: list[str]) -> list[str]:
    names = [re.sub(r"[^a-z0-9]+", "_", cell.lower()).strip("_") for cell in cells]
    if len([name for name in names if name]) < 2:
        raise InputError(
            f"{path}: the first line has fewer than two columns: expected a header with names"
            " separated by semicolons, tabs or commas"
        )
    for name, count in Counter(filter(None, names)).items():
        if count > 1:
            raise InputError(f"{path}: the header has the column {name} twice: expected once")
    return names


def _row(path: Path, line: int, columns: list[str], cells: list[str]) -> Row:
    place = f"{path}, line {line}"
    if any(cell.strip() for cell in cells[len(columns) :]):
        raise InputError(
            f"{place}: {len(cells)} cells, but the header has {len(columns)}: expected as many"
            " (with decimal commas, separate the columns by semicolons)"
        )
    return Row(
        place, line, {name: cell.strip() for name, cell in zip(columns, cells, strict=False)}
    )
