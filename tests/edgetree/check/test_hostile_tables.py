"""Tables of check from spreadsheets on Windows, and tables that no one measures."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from basetree.errors import InputError
from edgetree.check import Comparison, compare, read_caliper, read_measured
from edgetree.check import csv_file as reading
from edgetree.check.error_fit import fit_errors
from edgetree.check.stems import MeasuredTable
from edgetree.measure import Estimate

NAMES = ("diameter", "dbh", "cut_height")
HEADER = ("frame", "tree", *(f"{name}{end}" for name in NAMES for end in ("_m", "_std_m")))


def caliper(folder: Path, content: str | bytes) -> Path:
    path = folder / "caliper.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def measured(folder: Path, value: str = "0.3", std: str = "0.01", count: int = 3) -> Path:
    path = folder / "trees.csv"
    rows = [f"a,{tree},{value},{std},0.3,0.01,0.2,0.01" for tree in range(1, count + 1)]
    path.write_text("\n".join([",".join(HEADER), *rows, ""]))
    return path


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ('tree,diameter_cm,note\n1,30,\n2,31,"leans\n3,32,\n4,33,\n', 3),
        ('tree,diameter_cm,note\n1,30,"a\nb"\n2,31,"leans', 4),
        ('sep=;\ntree;diameter_cm;"note\n1;30;\n', 2),
    ],
)
def test_a_quote_that_is_not_closed_never_swallows_stems(
    tmp_path: Path, content: str, line: int
) -> None:
    with pytest.raises(InputError, match=rf"caliper\.csv, line {line}: a quote is not closed"):
        read_caliper(caliper(tmp_path, content))


def test_quotes_inside_of_cells_and_a_last_line_without_its_end_are_read(tmp_path: Path) -> None:
    table = read_caliper(caliper(tmp_path, 'tree,diameter_cm,note\n1,30,12"\n2,"31","x"'))
    assert [stem.values["diameter_m"].value for stem in table.stems] == [0.3, 0.31]


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig", "cp1252"])
def test_encodings_of_spreadsheets_are_read(tmp_path: Path, encoding: str) -> None:
    mark = "\ufeff" if encoding in ("utf-16-le", "utf-16-be") else ""
    text = f"{mark}tree\tdiameter_cm\tHöhe\r\n1\t27,6\tfünf\r\n2\t25,2\t\r\n"
    table = read_caliper(caliper(tmp_path, text.encode(encoding)))
    assert [stem.values["diameter_m"].value for stem in table.stems] == [0.276, 0.252]


@pytest.mark.parametrize(
    "content",
    [
        "tree,diameter_cm\n1,30\n".encode("utf-16-le"),
        b"\xff\xfe\x00\xd8\x00",
        b"tree,diameter_cm\n1,30\0\n",
        bytes(range(256)),
    ],
)
def test_what_is_no_text_is_named(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(InputError, match=r"caliper\.csv.* not a text file"):
        read_caliper(caliper(tmp_path, content))


@pytest.mark.parametrize(
    ("value", "std", "message"),
    [
        ("1e300", "0.01", "diameter_m is '1e300': expected a number, such as 31.4, of at most"),
        ("-1e200", "0.01", "diameter_m is '-1e200'"),
        ("1e10", "0.01", "diameter_m is '1e10'"),
        ("0.3", "1e-320", "diameter_std_m is '1e-320': expected 1e-06 m or more"),
        ("0.3", "1e-200", "diameter_std_m is '1e-200'"),
        ("0.3", "-1", "diameter_std_m is '-1'"),
        ("0.3", "9" * 400, "diameter_std_m is '99999"),
    ],
)
def test_numbers_that_nobody_measures_are_named(
    tmp_path: Path, value: str, std: str, message: str
) -> None:
    with pytest.raises(InputError, match="line 2: ") as raised:
        read_measured(measured(tmp_path, value, std))
    assert message in str(raised.value)
    assert len(str(raised.value)) < 300


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", ["1e9", "-1e9", "1e-300"])
@pytest.mark.parametrize("std", ["1e-6", "1e9"])
def test_the_largest_numbers_are_compared(tmp_path: Path, value: str, std: str) -> None:
    rows = "".join(f"{tree};31,4;0,1;25\n" for tree in range(1, 25))
    table = read_caliper(caliper(tmp_path, "tree;diameter_cm;diameter_std_cm;dbh_cm\n" + rows))
    result = compare(read_measured(measured(tmp_path, value, std, 24)), table)
    assert result.to_dict()["quantities"]["diameter_m"]["stems"] == 24


def test_many_columns_are_refused_at_once(tmp_path: Path) -> None:
    names = [f"c{number}" for number in range(30_000)]
    begin = time.process_time()
    for last in ("c7", "tree"):
        content = ";".join([*names, last]) + "\n1\n"
        with pytest.raises(InputError, match=r"the column c7 twice|has the columns c0"):
            read_caliper(caliper(tmp_path, content))
    assert time.process_time() - begin < 2


def test_sizes_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "_MOST_CELLS", 32)
    with pytest.raises(InputError, match="has more than 32 cells: expected fewer"):
        read_caliper(caliper(tmp_path, "tree,diameter_cm\n" + "1,30\n" * 5))
    with pytest.raises(InputError, match="larger than 2097152 bytes, the limit text_file_bytes"):
        read_caliper(caliper(tmp_path, "tree,diameter_cm\n" + "\n" * 2**21))
    monkeypatch.setattr("edgetree.check.stems._LARGEST_MEASURED_BYTES", 100)
    with pytest.raises(InputError, match=r"larger than 100 bytes.*, expected a CSV file"):
        read_measured(measured(tmp_path))


def test_a_table_of_a_long_run_is_read(tmp_path: Path) -> None:
    path = measured(tmp_path, value="0.300000000000" + "0" * 200, count=10_000)
    assert path.stat().st_size > 2 * 2**20
    assert len(read_measured(path).stems) == 10_000


def test_a_campaign_of_many_positions_is_matched_in_time(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    places = np.stack(np.meshgrid(np.arange(50), np.arange(50)), -1).reshape(-1, 2) * 5.0
    names = [f"cut_point_machine_{axis}_m" for axis in "xyz"]
    rows = [
        f"a,{tree},0.3,0.01,0.3,0.01,0.2,0.01,{x:.2f},{y:.2f},0"
        for tree, (x, y) in enumerate(places)
    ]
    path = tmp_path / "trees.csv"
    path.write_text("\n".join([",".join([*HEADER, *names]), *rows, ""]))
    typed = places + rng.normal(0, 0.05, places.shape)
    content = "x_m,y_m,diameter_cm\n" + "".join(f"{x:.2f},{y:.2f},30\n" for x, y in typed)
    table = read_caliper(caliper(tmp_path, content))
    begin = time.process_time()
    result = compare(read_measured(path), table)
    assert len(result.matching.pairs) == len(places)
    assert time.process_time() - begin < 5


def test_positions_that_are_too_many_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = read_caliper(caliper(tmp_path, "x_m,y_m,diameter_cm\n1,1,30\n1,1,30\n"))
    stem = read_measured(measured(tmp_path)).stems[0]
    stems = tuple(
        type(stem)("a", number, stem.values, point_machine_m=(1.0, 1.0, 0.0)) for number in range(3)
    )
    there = MeasuredTable("trees.csv", stems)
    monkeypatch.setattr("edgetree.check.matching._MOST_NEAR", 5)
    with pytest.raises(InputError, match=r"more than 5 pairs of stems are within 0\.5 m"):
        compare(there, table)
    monkeypatch.setattr("edgetree.check.matching._MOST_DISTANCES", 5)
    with pytest.raises(InputError, match=r"2 positions for 3 measured stems: expected fewer, or"):
        compare(there, table)


def test_very_many_stems_are_fitted_in_time() -> None:
    rng = np.random.default_rng(1)
    true_m = rng.uniform(0.2, 0.5, 20_000)
    errors_m = rng.normal(0, 0.02, true_m.size)
    comparisons = [
        Comparison(None, Estimate(value + error, 0.01), Estimate(value, 0.0))  # type: ignore[arg-type]
        for value, error in zip(true_m, errors_m, strict=True)
    ]
    begin = time.process_time()
    fit = fit_errors(comparisons)
    assert fit
    assert fit.factor.value == pytest.approx(2, rel=0.05)
    assert fit.coverage_after.value == pytest.approx(0.95, abs=0.01)
    assert time.process_time() - begin < 5
