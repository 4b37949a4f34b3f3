"""CSV tables for spreadsheets in countries with decimal commas."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from edgetree.check.csv_file import read_csv
from edgetree.results.csv_style import EXCEL, PLAIN, CsvStyle
from edgetree.results.csv_table import TRACKS, TREES, Table
from edgetree.samples import sample_frames

Cli = Callable[..., Any]

COLUMNS = ("frame", "diameter_m", "diameter_std_m", "diameter_low95_m", "position_x_m")
COLUMNS += ("position_std_x_m", "score", "box_x0_px", "warnings")
ROW = {
    "frame": "=plot",
    "diameter_m": 0.31416,
    "diameter_std_m": 0.01234,
    "diameter_low95_m": 0.28951,
    "position_x_m": -12.3456,
    "position_std_x_m": 0.0512,
    "score": 0.91234,
    "box_x0_px": 101.26,
    "warnings": ["a; b", "1.5 m"],
}


def written(style: CsvStyle, row: dict[str, object] = ROW, short: tuple[str, ...] = ()) -> str:
    stream = io.StringIO(newline="")
    table: Table[Any] = Table(COLUMNS, lambda _: [row], short)
    table.write_header(stream, style)
    table.write_rows(stream, None, style)
    return stream.getvalue()


def test_figures_have_a_decimal_comma_and_the_digits_that_their_errors_carry() -> None:
    text = written(EXCEL)
    assert text.startswith("\ufeffframe;diameter_m;")
    (row,) = csv.DictReader(io.StringIO(text[1:]), delimiter=";")
    assert row == {
        "frame": "'=plot",
        "diameter_m": "0,314",
        "diameter_std_m": "0,012",
        "diameter_low95_m": "0,290",
        "position_x_m": "-12,346",
        "position_std_x_m": "0,051",
        "score": "0,91",
        "box_x0_px": "101,3",
        "warnings": "a; b; 1.5 m",
    }


@pytest.mark.parametrize(
    ("std", "expected"), [(0.0, "0,314"), (float("inf"), "0,314"), (3.0, "0,3"), (25.0, "0")]
)
def test_a_figure_with_any_error_can_be_written(std: float, expected: str) -> None:
    text = written(EXCEL, ROW | {"diameter_std_m": std})
    assert text.splitlines()[1].split(";")[1] == expected


def test_the_table_for_programs_is_as_before() -> None:
    lines = written(PLAIN, short=("frame",)).splitlines()
    assert lines[0] == ",".join(COLUMNS)
    assert lines[1] == "'=plot,0.31416,0.01234,0.28951,-12.3456,0.0512,0.91234,101.26,a; b; 1.5 m"


def test_the_short_table_has_columns_of_the_long_one() -> None:
    assert written(EXCEL, short=("diameter_m", "frame")).splitlines()[1] == "0,314;'=plot"
    everything = replace(EXCEL, all_columns=True)
    assert written(everything, short=("frame",)).splitlines()[0].count(";") == len(COLUMNS) - 1
    for table in (TREES, TRACKS):
        assert set(table.short) < set(table.columns)
        assert len(table.short) < len(table.columns) / 2


@pytest.fixture
def sample(tmp_path: Path) -> tuple[object, ...]:
    frame = sample_frames()[0]
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps(frame.camera.to_dict()))
    return (frame.image_path, "--depth", frame.depth_path, "--camera", camera)


def test_check_reads_what_measure_writes_for_spreadsheets(
    run_cli: Cli, sample: tuple[object, ...], tmp_path: Path
) -> None:
    verdicts = []
    for name, options in (("plain", ()), ("short", ()), ("long", ("--all-columns",))):
        table = tmp_path / f"{name}.csv"
        style = () if name == "plain" else ("--csv-style", "excel")
        done = run_cli("measure", *sample, "--csv", table, *style, *options)
        assert done.code == 0, done.err
        rows = read_csv(table).rows
        measured = [row for row in rows if row.text("diameter_m")]
        (tmp_path / "caliper.csv").write_text(
            "tree;diameter_cm\n" + "".join(f"{row.text('tree')};20,5\n" for row in measured)
        )
        done = run_cli("check", table, tmp_path / "caliper.csv", "--json", "--out", tmp_path / name)
        verdicts.append(json.loads(done.out)["quantities"]["diameter_m"])
    plain, short, long = verdicts
    assert short == long
    assert short["stems"] == plain["stems"] > 1
    assert short["bias_m"] == pytest.approx(plain["bias_m"], abs=2e-3)


def test_a_table_for_spreadsheets_is_no_table_of_a_caliper(
    run_cli: Cli, sample: tuple[object, ...], tmp_path: Path
) -> None:
    table = tmp_path / "trees.csv"
    run_cli("measure", *sample, "--csv", table, "--csv-style", "excel")
    done = run_cli("check", table, table)
    assert done.code == 2
    assert "is a machine's table" in done.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--csv-style", "excel"), "--csv-style given without a CSV file to write"),
        (
            ("--csv", "t.csv", "--csv-style", "Excel"),
            "--csv-style is 'Excel': expected plain or excel",
        ),
        (("--csv", "t.csv", "--all-columns"), "--all-columns given without --csv-style excel"),
    ],
)
def test_options_that_do_not_fit_are_named(
    run_cli: Cli, sample: tuple[object, ...], options: tuple[str, ...], message: str
) -> None:
    done = run_cli("measure", *sample, *options)
    assert (done.code, done.out) == (2, "")
    assert message in done.err
