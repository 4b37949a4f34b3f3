"""Reading the caliper's and the machine's tables: separators, decimal commas, units, mistakes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from basetree.errors import InputError
from edgetree.check import read_caliper, read_measured
from edgetree.detections import TreeDetections
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import FoundTrees, FrameResult
from edgetree.measure import Estimate, Failure, PointEstimate, TreeMeasurement
from edgetree.results.csv_table import TREES


def written(folder: Path, content: str | bytes) -> Path:
    path = folder / "caliper.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(
    "content",
    [
        "frame,tree,diameter_cm\na,3,31.4\na,4,28\n",
        '"frame","tree","diameter_cm"\na,3,"31,4"\na,4,28.0\n',
        "\ufeffFrame;Tree;Diameter (cm)\r\na;3;31,4\r\n;;\r\na;4;28,0\r\n",
        "frame\ttree\tdiameter_cm\r a\t3\t31,4\r a\t4\t28\r",
        "\ufeffsep=;\r\nframe; tree ;DIAMETER [cm];;\r\na;3; 31,4 ;;\r\na;4;28;;\r\n",
        "frame;tree;diameter_cm;Höhe\na;3;31,4;ä\na;4;28;\n".encode("cp1252"),
        "frame,tree,diameter_cm,note\na,3,31.4,\na,5,,lost\na,4.0,2.8e1,\n",
    ],
    ids=["comma", "quoted", "semicolon", "tab", "sep", "cp1252", "without_reading"],
)
def test_spreadsheets_of_all_countries_are_understood(tmp_path: Path, content: str | bytes) -> None:
    stems = read_caliper(written(tmp_path, content)).stems
    assert [(stem.frame, stem.tree) for stem in stems] == [("a", 3), ("a", 4)]
    values = [stem.values["diameter_m"] for stem in stems]
    assert np.allclose(values, [(0.314, 0), (0.28, 0)])


@pytest.mark.parametrize(
    ("column", "text"), [("mm", "508"), ("cm", "50,8"), ("m", "0.508"), ("in", "20")]
)
def test_units_become_metres(tmp_path: Path, column: str, text: str) -> None:
    content = f"tree;diameter_{column};diameter_std_{column};dbh_{column};cut_height_{column}\n"
    (stem,) = read_caliper(written(tmp_path, content + f"1;{text};1;{text};{text}\n")).stems
    unit_m = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254}[column]
    assert stem.values["diameter_m"] == pytest.approx((0.508, unit_m))
    assert stem.values["dbh_m"] == stem.values["cut_height_m"] == pytest.approx((0.508, 0.0))


def test_positions_are_read(tmp_path: Path) -> None:
    stems = read_caliper(written(tmp_path, "X;y (m);dbh_cm\n1,5;-2;30\n0;3;31\n")).stems
    assert [stem.point_m for stem in stems] == [(1.5, -2.0, None), (0.0, 3.0, None)]
    assert [stem.line for stem in stems] == [2, 3]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "fewer than two columns"),
        ("tree\n1\n", "fewer than two columns"),
        ("tree,diameter_cm\n", "no rows: expected a header and a row"),
        ("tree,diameter_cm\n1,\n", "no reading: expected a diameter"),
        ("tree,diameter\n1,30\n", "has the columns tree, diameter: expected a diameter as"),
        ("diameter_cm,remark\n30,x\n", "expected tree (the number in the machine's table), or"),
        ("x_m,diameter_cm\n1,30\n", "expected tree (the number in the machine's table), or"),
        ("tree,diameter_cm,diameter_mm\n1,30,300\n", "diameter_cm and diameter_mm: expected one"),
        ("tree,Tree,diameter_cm\n1,1,30\n", "column tree twice"),
        ("tree,diameter_cm\n1,31,4\n", "line 2: 3 cells, but the header has 2"),
        ("tree,diameter_cm\n1,30\n2,thick\n", "line 3: diameter_cm is 'thick': expected a number"),
        ("tree,diameter_cm\n1,nan\n", "line 2: diameter_cm is 'nan'"),
        ("tree,diameter_cm\n1,1e999\n", "line 2: diameter_cm is '1e999'"),
        ("tree;diameter_mm\n1;1.234,5\n", "line 2: diameter_mm is '1.234,5'"),
        ("tree,diameter_cm\n1,314\n", "which is 3.14 m: expected 0.01 to 3 m (is the unit right?)"),
        ("tree,diameter_m\n1,-0.3\n", "which is -0.3 m"),
        ("tree,diameter_cm,diameter_std_cm\n1,30,-1\n", "diameter_std_cm is negative"),
        ("tree,diameter_cm\n,30\n", "line 2: tree is empty"),
        ("tree,diameter_cm\n1.5,30\n", "tree is '1.5': expected a whole number"),
        ("x_m,y_m,z_m,diameter_cm\n1,2,,30\n", "line 2: z_m is empty: expected metres"),
        (b"PK\x03\x04\0\0", "is not a text file"),
    ],
)
def test_a_mistake_is_named(tmp_path: Path, content: str | bytes, message: str) -> None:
    path = written(tmp_path, content)
    with pytest.raises(InputError) as raised:
        read_caliper(path)
    assert str(raised.value).startswith(str(path))
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.csv: (no such file|cannot be read)"):
        read_caliper(tmp_path / "none.csv")
    with pytest.raises(InputError, match="cannot be read"):
        read_measured(tmp_path)


@pytest.fixture
def measured_csv(tmp_path: Path) -> Path:
    """The table that `edgetree run --csv` writes for two trees of one frame."""
    tree = replace(
        TreeMeasurement.failed("no ground ± here"),
        diameter_m=Estimate(0.312, 0.008),
        cut_point_m=PointEstimate(np.array([0.1, 0.2, 5.0]), np.full(3, 0.02)),
    )
    trees = TreeDetections(
        boxes_px=np.array([[1, 2, 30, 40], [31, 2, 60, 40]], np.float32),
        scores=np.array([0.9, 0.8], np.float32),
        keypoints_px=None,
        masks=None,
        image_width=64,
        image_height=48,
    )
    frame = Frame("-1", Path("x"), None)
    found, both = FoundTrees(trees, (4, 5)), [tree, TreeMeasurement.failed("no depth")]
    path = tmp_path / "trees.csv"
    with path.open("w", encoding="utf-8", newline="") as stream:
        TREES.write_header(stream)
        TREES.write_rows(stream, FrameResult(frame, found, both, None))
    return path


def test_the_table_of_run_is_read(measured_csv: Path) -> None:
    table = read_measured(measured_csv)
    first, second = table.stems
    assert table.source == str(measured_csv)
    assert [stem.name for stem in table.stems] == ["-1 tree 4", "-1 tree 5"]
    assert first.values["diameter_m"] == Estimate(0.312, 0.008)
    assert first.values["dbh_m"] == Failure("no ground ± here")
    assert first.point_camera_m == (0.1, 0.2, 5.0)
    assert first.point_machine_m is None
    assert second.values["diameter_m"] == Failure("no depth")
    assert second.point_camera_m is None


def test_the_table_of_run_saved_by_a_spreadsheet_is_read(measured_csv: Path) -> None:
    expected = read_measured(measured_csv)
    lines = measured_csv.read_text("utf-8").splitlines()
    cells = [line.split(",") for line in lines]
    saved = "\r\n".join(";".join(cell.replace(".", ",") for cell in row) for row in cells)
    measured_csv.write_text("\ufeff" + saved, encoding="utf-8")
    assert read_measured(measured_csv) == expected


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("diameter_std_m", "other", "has no column diameter_std_m: expected the table of"),
        ("0.312,0.008,", "0.312,,", "line 2: diameter_std_m is '': expected 1e-06 m or more"),
        ("0.312,0.008,", "0.312,0,", "line 2: diameter_std_m is '0': expected 1e-06 m or more"),
        ("0.312,0.008,", "?,0.008,", "line 2: diameter_m is '?'"),
        ("'-1,4,", "'-1,,", "line 2: tree is empty"),
    ],
)
def test_a_broken_table_of_run_is_named(
    measured_csv: Path, old: str, new: str, message: str
) -> None:
    text = measured_csv.read_text("utf-8")
    assert old in text
    measured_csv.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as raised:
        read_measured(measured_csv)
    assert message in str(raised.value)
