"""Stems over time as a CSV table: one row for each frame and stem, units in the column names."""

from __future__ import annotations

import csv
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

from edgetree.live.results import LiveResult
from edgetree.live.sinks.growing_file import growing_file
from edgetree.live.sinks.records import TRACK_QUANTITIES, track_record
from edgetree.measure.estimates import split_unit
from edgetree.results.csv_table import cell

__all__ = ["TRACK_COLUMNS", "CsvTracksSink"]

_POINTS: Final = ("position_m", "position_std_m", "position_camera_m")


def _point_columns(key: str) -> list[str]:
    return [f"{key.removesuffix('_m')}_{axis}_m" for axis in "xyz"]


def _quantity_columns(quantity: str) -> list[str]:
    name, unit = split_unit(quantity)
    return [
        quantity,
        *(f"{name}_{what}_{unit}" for what in ("std", "low95", "high95")),
        f"{name}_failure",
    ]


TRACK_COLUMNS: Final = (
    "frame",
    "time_s",
    "track",
    "state",
    "tree",
    *(column for key in _POINTS for column in _point_columns(key)),
    *(column for quantity in TRACK_QUANTITIES for column in _quantity_columns(quantity)),
    "frames",
    "views",
    "arc_deg",
    "more_views_help",
    "last_seen_s",
    "warnings",
)


class CsvTracksSink:
    """Writes a row for each stem that is followed, seen in the frame or not.

    Args:
        path: the file to write, which has every frame at once.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._files = ExitStack()
        self._stream = self._files.enter_context(growing_file(path))
        self._rows = csv.DictWriter(self._stream, TRACK_COLUMNS)
        self._rows.writeheader()

    def write(self, result: LiveResult) -> None:
        """Write the rows of one frame."""
        for track in result.tracks:
            self._rows.writerow(_row(result, track_record(track)))
        self._stream.flush()

    def close(self) -> None:
        """Complete the file."""
        self._files.close()


def _row(result: LiveResult, record: dict[str, Any]) -> dict[str, Any]:
    values = {"frame": result.frame.number, "time_s": result.frame.time_s, **record}
    for key in _POINTS:
        values |= zip(_point_columns(key), values.pop(key), strict=True)
    return {name: cell(value) for name, value in values.items()}
