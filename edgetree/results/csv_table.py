"""Measurements as a CSV table: one row per tree, units in the column names."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, TextIO

from edgetree.frames.pipeline import FrameResult
from edgetree.measure import QUANTITIES, TreeMeasurement
from edgetree.measure.estimates import split_unit

__all__ = ["COLUMNS", "cell", "measurements_of", "write_header", "write_rows"]

_BOX: Final = ("box_x0_px", "box_y0_px", "box_x1_px", "box_y1_px")
_POINTS: Final = {"cut_point": "cut_point_camera", "cut_point_machine": "cut_point_machine"}
_EVIDENCE: Final = ("method", "arc_deg", "valid_depth_share", "visible_share", "ground", "warnings")
_PROFILE: Final = (
    "profile_heights_from",
    "profile_lowest_m",
    "profile_highest_m",
    "profile_failure",
)
_FORMULA_SIGNS: Final = ("=", "+", "-", "@", "\t", "\r")
_DIGITS: Final = 5


def _quantity_columns(quantity: str) -> tuple[str, ...]:
    """The columns of a quantity, with the keys of `TreeMeasurement.to_dict`."""
    name, unit = split_unit(quantity)
    spread = (f"{name}_{what}_{unit}" for what in ("std", "low95", "high95"))
    return (quantity, *spread, f"{name}_failure")


def _point_columns(name: str) -> tuple[str, ...]:
    return (*(f"{name}_{axis}_m" for axis in "xyz"), f"{name}_failure")


COLUMNS: Final = (
    "frame",
    "tree",
    "score",
    *_BOX,
    *(column for quantity in QUANTITIES for column in _quantity_columns(quantity)),
    "species",
    *_PROFILE,
    *(column for name in _POINTS.values() for column in _point_columns(name)),
    *_EVIDENCE,
)


def write_header(stream: TextIO) -> None:
    """Write the column names. The stream must have been opened with `newline=""`."""
    csv.writer(stream).writerow(COLUMNS)


def write_rows(stream: TextIO, result: FrameResult) -> None:
    """Write one row for each tree of a frame.

    Cells without a value are empty; the column `<quantity>_failure` then gives the reason.
    """
    writer = csv.DictWriter(stream, COLUMNS)
    writer.writerows({name: cell(value) for name, value in row.items()} for row in _rows(result))
    stream.flush()


def measurements_of(result: FrameResult) -> list[TreeMeasurement]:
    """The measurement of each tree; failures that name the missing options if there is none."""
    if result.measurements is not None:
        return result.measurements
    return [TreeMeasurement.failed(f"metres {result.metres_need}")] * len(result.trees)


def _rows(result: FrameResult) -> Iterator[dict[str, Any]]:
    trees, measurements = result.trees, measurements_of(result)
    for index, number in enumerate(result.found.numbers):
        yield {
            "frame": result.frame.name,
            "tree": number,
            "score": float(trees.scores[index]),
            **dict(zip(_BOX, trees.boxes_px[index].tolist(), strict=True)),
            **_metres(measurements[index].to_dict()),
        }


def _metres(values: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of `TreeMeasurement.to_dict` by column name."""
    row = {name: value for name, value in values.items() if name in COLUMNS}
    for name, column in _POINTS.items():
        x, y, z, failure = _point_columns(column)
        row |= zip((x, y, z), values.get(f"{name}_m", ()), strict=False)
        row[failure] = values.get(f"{name}_failure")
    if "profile" in values:
        profile = values["profile"]
        ends = (profile["height_m"][0], profile["height_m"][-1])
        row |= zip(_PROFILE, (profile["heights_from"], *ends), strict=False)
    evidence = values["evidence"]
    return {**row, **{name: evidence[name] for name in _EVIDENCE}}


def cell(value: object) -> object:
    """A value for a cell.

    Numbers are rounded to five digits. Text is put on one line, and escaped if a spreadsheet
    would take it for a formula.
    """
    if isinstance(value, float):
        return round(value, _DIGITS)
    if isinstance(value, Iterable) and not isinstance(value, str):
        value = "; ".join(map(str, value))
    if not isinstance(value, str):
        return value
    text = " ".join(value.split())
    return f"'{text}" if text.startswith(_FORMULA_SIGNS) else text
