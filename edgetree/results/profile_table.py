"""Diameters along stems as a CSV table: one row per tree and height."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TextIO

from basetree.files.writing import text_file
from edgetree.frames.pipeline import FrameResult
from edgetree.measure import Estimate, StemProfile
from edgetree.results.csv_table import cell, measurements_of

__all__ = ["PROFILE_COLUMNS", "profiles_file", "write_profile_header", "write_profile_rows"]

PROFILE_COLUMNS: Final = (
    "frame",
    "tree",
    "heights_from",
    "height_m",
    "diameter_m",
    "diameter_std_m",
    "diameter_low95_m",
    "diameter_high95_m",
)


@contextmanager
def profiles_file(path: Path) -> Iterator[Callable[[FrameResult], None]]:
    """Write the table; yields a function that adds the trees of a frame.

    Trees without a profile have no rows. If the block raises, no file is left.

    Raises:
        InputError: the file cannot be written.
    """
    with text_file(path) as stream:
        write_profile_header(stream)

        def add(result: FrameResult) -> None:
            write_profile_rows(stream, result)
            stream.flush()

        yield add


def write_profile_header(stream: TextIO) -> None:
    """Write the column names. The stream must have been opened with `newline=""`."""
    csv.writer(stream).writerow(PROFILE_COLUMNS)


def write_profile_rows(stream: TextIO, result: FrameResult) -> None:
    """Write the rows of a frame's trees; those without a profile have none."""
    writer = csv.writer(stream)
    for number, tree in zip(result.found.numbers, measurements_of(result), strict=True):
        if isinstance(tree.profile, StemProfile):
            for values in _values(tree.profile):
                writer.writerow([cell(value) for value in (result.frame.name, number, *values)])


def _values(profile: StemProfile) -> Iterator[tuple[Any, ...]]:
    """The columns from `heights_from` on."""
    for height_m, diameter_m, std_m in zip(
        profile.height_m.tolist(),
        profile.diameter_m.tolist(),
        profile.diameter_std_m.tolist(),
        strict=True,
    ):
        interval = Estimate(diameter_m, std_m).interval95
        yield profile.heights_from, height_m, diameter_m, std_m, *interval
