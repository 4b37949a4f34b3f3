"""The CSV table: units in column names, one row per tree, escaped formulas."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from edgetree.detections import TreeDetections
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import FoundTrees, FrameResult
from edgetree.measure import QUANTITIES, Estimate, Evidence, PointEstimate, TreeMeasurement
from edgetree.measure.estimates import split_unit
from edgetree.results.csv_table import TREES

MEASURED = replace(
    TreeMeasurement.failed("no ground ± here"),
    diameter_m=Estimate(0.312, 0.01),
    cut_point_m=PointEstimate(np.array([0.1, 0.2, 5.0]), np.full(3, 0.02)),
    evidence=Evidence(
        method="mask + depth",
        arc_deg=92.0,
        valid_depth_share=0.8,
        visible_share=0.9,
        ground="-a plane",
        warnings=("first", "second\nline"),
    ),
)


def _rows(
    measurements: list[TreeMeasurement] | None, name: str = "frame_1"
) -> list[dict[str, str]]:
    trees = TreeDetections(
        boxes_px=np.array([[1, 2, 30, 40.5]], np.float32),
        scores=np.array([0.9], np.float32),
        keypoints_px=None,
        masks=None,
        image_width=64,
        image_height=48,
    )
    need = "need depth: pass --depth" if measurements is None else None
    found = FoundTrees(trees, (4,))
    result = FrameResult(Frame(name, Path("x"), None), found, measurements, need)
    stream = io.StringIO(newline="")
    TREES.write_header(stream)
    TREES.write_rows(stream, result)
    return list(csv.DictReader(io.StringIO(stream.getvalue(), newline="")))


def test_a_row_has_values_intervals_points_and_evidence() -> None:
    (row,) = _rows([MEASURED])
    assert (row["frame"], row["tree"], row["box_y1_px"]) == ("frame_1", "4", "40.5")
    assert float(row["score"]) == pytest.approx(0.9)
    low, high = MEASURED.diameter_m.interval95  # type: ignore[union-attr]
    spread = [row[f"diameter_{name}_m"] for name in ("std", "low95", "high95")]
    assert [row["diameter_m"], *spread] == ["0.312", "0.01", f"{low:g}", f"{high:g}"]
    assert row["diameter_failure"] == ""
    assert [row[f"cut_point_camera_{axis}_m"] for axis in "xyz"] == ["0.1", "0.2", "5.0"]
    assert (row["method"], row["arc_deg"]) == ("mask + depth", "92.0")
    assert (row["valid_depth_share"], row["visible_share"]) == ("0.8", "0.9")


def test_a_failed_quantity_is_empty_and_has_a_reason() -> None:
    (row,) = _rows([MEASURED])
    assert (row["cut_height_m"], row["cut_height_std_m"]) == ("", "")
    assert row["cut_height_failure"] == "no ground ± here"
    assert row["cut_point_machine_x_m"] == ""
    assert row["cut_point_machine_failure"] == "no ground ± here"


def test_all_quantities_have_columns_with_units() -> None:
    for quantity in QUANTITIES:
        name, unit = split_unit(quantity)
        expected = {quantity, f"{name}_failure"}
        expected |= {f"{name}_{what}_{unit}" for what in ("std", "low95", "high95")}
        assert expected <= set(TREES.columns)
    assert len(set(TREES.columns)) == len(TREES.columns)


def test_text_is_one_line_and_formulas_are_escaped() -> None:
    (row,) = _rows([MEASURED], name="=HYPERLINK(1)")
    assert row["frame"] == "'=HYPERLINK(1)"
    assert row["ground"] == "'-a plane"
    assert row["warnings"] == "first; second line"


def test_without_measurements_each_failure_asks_for_the_missing_option() -> None:
    (row,) = _rows(None)
    assert row["diameter_failure"] == "metres need depth: pass --depth"
    assert row["diameter_m"] == ""


def test_negative_numbers_stay_numbers() -> None:
    leaning = replace(MEASURED, lean_direction_deg=Estimate(-90.0, 1.0))
    assert float(_rows([leaning])[0]["lean_direction_deg"]) == -90.0
