"""Stems as the machine measured them and as a person measured them, read from CSV files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

from basetree.errors import InputError
from edgetree.check.csv_file import CsvFile, Row, read_csv
from edgetree.measure import Estimate, Failure

CHECKED: Final = ("diameter_m", "dbh_m", "cut_height_m")
"""The quantities that are compared, with the keys of `TreeMeasurement`."""

Point: TypeAlias = tuple[float | None, float | None, float | None]

_METRES_PER_UNIT: Final = {"cm": 0.01, "mm": 0.001, "m": 1.0, "in": 0.0254}
# Readings outside of these limits are taken for errors of the unit.
_LIMITS_M: Final = {"diameter_m": (0.01, 3.0), "dbh_m": (0.01, 3.0), "cut_height_m": (0.0, 3.0)}
_LARGEST_MEASURED_BYTES: Final = 16 * 2**20  # a tree has about 300
_SMALLEST_STD_M: Final = 1e-6
_MOST_STEMS: Final = 20_000  # of a table that a person typed
_ESCAPED: Final = re.compile(r"'(?=[=+\-@])")


@dataclass(frozen=True)
class MeasuredStem:
    """A stem that the machine measured.

    Attributes:
        frame: Name of the frame.
        tree: Number of the tree in the frame.
        values: The measured quantities of `CHECKED`, or the reason why there is no value.
        point_camera_m: The cut point in the camera's frame (x right, y down, z forward), metres;
            None if it is not known.
        point_machine_m: The cut point in the machine's frame (x forward, y left, z up).
    """

    frame: str
    tree: int
    values: Mapping[str, Estimate | Failure]
    point_camera_m: tuple[float, float, float] | None = None
    point_machine_m: tuple[float, float, float] | None = None

    @property
    def name(self) -> str:
        """Frame and number, for messages and tables."""
        return f"{self.frame} tree {self.tree}"


@dataclass(frozen=True)
class CaliperStem:
    """A stem that a person measured.

    Attributes:
        line: Number of its line in the file.
        values: The measured quantities of `CHECKED`, with their standard deviations; 0 if they are
            not known.
        frame: Name of the frame; None if the file does not say it.
        tree: Number of the tree in the frame; None if the stem is found by its position.
        point_m: Coordinates x, y, z in metres; None for those that were not measured.
    """

    line: int
    values: Mapping[str, Estimate]
    frame: str | None = None
    tree: int | None = None
    point_m: Point = (None, None, None)

    @property
    def name(self) -> str:
        """Line, frame and number, for messages and tables."""
        parts = [self.frame or "", "" if self.tree is None else f"tree {self.tree}"]
        return " ".join(part for part in (f"line {self.line}:", *parts) if part).rstrip(":")


@dataclass(frozen=True)
class MeasuredTable:
    """The machine's table.

    Attributes:
        source: Name of the table for messages, such as its path.
        stems: Its rows.
    """

    source: str
    stems: tuple[MeasuredStem, ...]


@dataclass(frozen=True)
class CaliperTable:
    """The table of a person with a caliper or tape.

    Attributes:
        source: Name of the table for messages, such as its path.
        stems: Its rows.
    """

    source: str
    stems: tuple[CaliperStem, ...]


def read_measured(path: Path) -> MeasuredTable:
    """Read a table of `edgetree run --csv` or `edgetree measure --csv`.

    Raises:
        InputError: The file cannot be read, a column is missing, or a value is not a number.
    """
    file = read_csv(path, _LARGEST_MEASURED_BYTES)
    needed = ("frame", "tree", *(name for each in CHECKED for name in (each, _std(each))))
    for column in needed:
        if column not in file.columns:
            raise InputError(
                f"{path} has no column {column}: expected the table of `edgetree run --csv`,"
                " and the caliper's file after it"
            )
    return MeasuredTable(str(path), tuple(_measured_stem(row) for row in file.rows))


def _std(quantity: str) -> str:
    return f"{quantity.removesuffix('_m')}_std_m"


def _measured_stem(row: Row) -> MeasuredStem:
    tree = row.whole_number("tree")
    if tree is None:
        raise InputError(f"{row.place}: tree is empty: expected a number")
    return MeasuredStem(
        frame=_ESCAPED.sub("", row.text("frame"), count=1),
        tree=tree,
        values={quantity: _measured_value(row, quantity) for quantity in CHECKED},
        point_camera_m=_cut_point(row, "camera"),
        point_machine_m=_cut_point(row, "machine"),
    )


def _measured_value(row: Row, quantity: str) -> Estimate | Failure:
    value, std = row.number(quantity), row.number(_std(quantity))
    if value is None:
        return Failure(row.text(f"{quantity.removesuffix('_m')}_failure") or "no value")
    if std is None or std < _SMALLEST_STD_M:
        text = row.text(_std(quantity))
        raise InputError(
            f"{row.place}: {_std(quantity)} is {text!r:.60}: expected {_SMALLEST_STD_M:g} m or more"
        )
    return Estimate(value, std)


def _cut_point(row: Row, frame: str) -> tuple[float, float, float] | None:
    x, y, z = (row.number(f"cut_point_{frame}_{axis}_m") for axis in "xyz")
    return None if x is None or y is None or z is None else (x, y, z)


def read_caliper(path: Path) -> CaliperTable:
    """Read a table that a person typed, with one row for each stem.

    Columns, of which case, spaces and brackets do not matter ("Diameter (cm)" is `diameter_cm`):

    - `tree`, the number in the machine's table, or the position `x_m`, `y_m`, `z_m` in metres. The
      vertical coordinate may be left out. `frame` is needed if the machine's table has several.
    - `diameter_cm`, `_mm`, `_m` or `_in`, likewise `dbh_cm` and `cut_height_cm`. At least one of
      diameter and DBH.
    - `diameter_std_cm` and so on, the standard deviation of the readings. Optional.

    Rows without a reading are left out.

    Raises:
        InputError: The file cannot be read, a column is missing, or a value is not plausible.
    """
    file = read_csv(path)
    if "diameter_failure" in file.columns:
        raise InputError(f"{path} is a machine's table: expected the readings of a caliper")
    columns = {quantity: _reading_column(file, quantity) for quantity in CHECKED}
    stds = {quantity: _reading_column(file, _std(quantity)) for quantity in CHECKED}
    if columns["diameter_m"] is None and columns["dbh_m"] is None:
        raise InputError(
            f"{path} has the columns {', '.join(file.columns)}: expected a diameter as diameter_cm,"
            " diameter_mm, diameter_m or diameter_in, or a DBH as dbh_cm and so on"
        )
    by_number = "tree" in file.columns
    if not by_number and _point_columns(file).count(None) > 1:
        raise InputError(
            f"{path} has the columns {', '.join(file.columns)}: expected tree (the number in the"
            " machine's table), or the position x_m, y_m, z_m"
        )
    stems = []
    for row in file.rows:
        values = {
            quantity: reading
            for quantity, column in columns.items()
            if column and (reading := _reading(row, quantity, column, stds[quantity])) is not None
        }
        if values:
            stems.append(_caliper_stem(row, values, by_number, _point_columns(file)))
    if not stems:
        raise InputError(f"{path} has no reading: expected a diameter for at least one stem")
    if len(stems) > _MOST_STEMS:
        raise InputError(f"{path} has {len(stems)} stems: expected at most {_MOST_STEMS}")
    return CaliperTable(str(path), tuple(stems))


def _reading_column(file: CsvFile, quantity: str) -> str | None:
    """The column of a quantity, in any unit."""
    name = quantity.removesuffix("_m")
    found = [f"{name}_{unit}" for unit in _METRES_PER_UNIT if f"{name}_{unit}" in file.columns]
    if len(found) > 1:
        raise InputError(f"{file.path} has the columns {' and '.join(found)}: expected one of them")
    return found[0] if found else None


def _point_columns(file: CsvFile) -> tuple[str | None, str | None, str | None]:
    x, y, z = (
        next((name for name in (f"{axis}_m", axis) if name in file.columns), None) for axis in "xyz"
    )
    return x, y, z


def _metres(row: Row, column: str) -> float | None:
    value = row.number(column)
    return None if value is None else value * _METRES_PER_UNIT[column.rpartition("_")[2]]


def _reading(row: Row, quantity: str, column: str, std_column: str | None) -> Estimate | None:
    value_m = _metres(row, column)
    if value_m is None:
        return None
    low_m, high_m = _LIMITS_M[quantity]
    if not low_m <= value_m <= high_m:
        raise InputError(
            f"{row.place}: {column} is {row.text(column)}, which is {value_m:g} m: expected"
            f" {low_m:g} to {high_m:g} m (is the unit right?)"
        )
    std_m = _metres(row, std_column) if std_column else 0.0
    if std_m is not None and std_m < 0:
        raise InputError(f"{row.place}: {std_column} is negative: expected 0 or more")
    return Estimate(value_m, std_m or 0.0)


def _caliper_stem(
    row: Row,
    values: Mapping[str, Estimate],
    by_number: bool,
    point_columns: tuple[str | None, str | None, str | None],
) -> CaliperStem:
    tree = row.whole_number("tree")
    x, y, z = (None if column is None else row.number(column) for column in point_columns)
    if by_number and tree is None:
        raise InputError(f"{row.place}: tree is empty: expected the number of the tree")
    if not by_number:
        for column, value in zip(point_columns, (x, y, z), strict=True):
            if column is not None and value is None:
                raise InputError(f"{row.place}: {column} is empty: expected metres")
    return CaliperStem(row.line, values, row.text("frame") or None, tree, (x, y, z))
