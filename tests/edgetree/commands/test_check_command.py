"""Tests of `edgetree check`: text, JSON, files, exit codes and mistakes."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from edgetree.measure import MeasureSettings
from edgetree.results.csv_table import TREES

Cli = Callable[..., Any]


def write_tables(folder: Path, count: int, factor: float, scale: float = 1.0) -> None:
    """Write `trees.csv`, as `edgetree run --csv` does, and `caliper.csv`."""
    rng = np.random.default_rng(5)
    with (folder / "trees.csv").open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, TREES.columns)
        writer.writeheader()
        lines = ["Frame;Tree;Diameter (cm);DBH (cm)"]
        for number in range(count):
            true_m = rng.uniform(0.15, 0.6)
            std_m = 0.03 * true_m
            row: dict[str, Any] = {"frame": f"f{number // 4}", "tree": number % 4 + 1}
            row |= {"dbh_failure": "the stem is not seen at breast height"}
            row |= {"diameter_m": scale * true_m + factor * std_m * rng.normal()}
            row |= {"diameter_std_m": std_m, "cut_point_camera_x_m": float(number)}
            row |= {"cut_point_camera_y_m": 0.2, "cut_point_camera_z_m": 4.0}
            writer.writerow(row)
            lines.append(f"f{number // 4};{number % 4 + 1};{true_m * 100:.2f};30".replace(".", ","))
    (folder / "caliper.csv").write_text("\r\n".join(lines), encoding="utf-8-sig")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to a folder with the tables of a machine that keeps its stated errors."""
    monkeypatch.chdir(tmp_path)
    write_tables(tmp_path, 32, factor=1.0)
    return tmp_path


CHECK = ("check", "trees.csv", "caliper.csv")


def test_a_good_machine_passes(run_cli: Cli, folder: Path) -> None:
    done = run_cli(*CHECK)
    assert done.code == 0, done.err
    lines = done.out.splitlines()
    assert lines[0] == "32 stems matched by frame and tree number"
    assert "diameter: 32 stems" in lines
    assert "DBH: not measured on any of 32 stems, the first: the stem is not seen" in done.out
    assert "keep the settings" in done.out
    assert lines[-1] == "result: passed"
    assert done.err == "next: edgetree check trees.csv caliper.csv --out check\n"


def test_a_machine_with_too_small_errors_fails_and_gets_settings(
    run_cli: Cli, folder: Path
) -> None:
    write_tables(folder, 32, factor=2.5)
    done = run_cli(*CHECK, "--out", "out/check")
    assert done.code == 1
    assert "result: failed: diameter: the 95 % intervals hold" in done.out
    assert done.err.splitlines()[-1].startswith("edgetree: trees.csv: the check failed: diameter:")
    saved = json.loads(Path("out/check/settings.json").read_text())
    assert saved["schema"] == "edgetree.check_settings/1"
    settings = MeasureSettings(**saved["settings"])
    expected = MeasureSettings().keypoint_spread * saved["factor"]
    assert settings.keypoint_spread == pytest.approx(expected, rel=1e-3)
    assert saved["coverage_after"]["count"] > saved["coverage_before"]["count"]
    assert f"keypoint_spread={settings.keypoint_spread:g}" in done.out


def test_a_wrong_scale_fails_and_names_the_depth_scale(run_cli: Cli, folder: Path) -> None:
    write_tables(folder, 32, factor=1.0, scale=1.05)
    done = run_cli(*CHECK)
    assert done.code == 1
    assert "is no chance, and more than 2 %" in done.err
    (scale,) = (
        float(line.split()[1]) for line in done.out.splitlines() if line.startswith("  scale ")
    )
    assert scale == pytest.approx(1.05, abs=0.02)
    (new,) = (
        float(line.split("--depth-scale ")[1].split()[0])
        for line in done.out.splitlines()
        if "--depth-scale" in line
    )
    assert new == pytest.approx(0.001 / scale, rel=1e-3)


def test_json_is_one_object_with_the_files(run_cli: Cli, folder: Path) -> None:
    done = run_cli(*CHECK, "--json", "--out", "out")
    assert done.code == 0, done.err
    record = json.loads(done.out)
    assert (record["schema"], record["passed"], record["matched"]) == ("edgetree.check/1", True, 32)
    assert record["matched_by"] == "number"
    assert record["files"] == ["out/matched.csv", "out/diameter.png", "out/settings.json"]
    picture = cv2.imread("out/diameter.png")
    assert picture is not None
    assert picture.shape == (860, 1640, 3)
    with Path("out/matched.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 32
    error_m = float(rows[0]["diameter_measured_m"]) - float(rows[0]["diameter_caliper_m"])
    assert float(rows[0]["diameter_error_m"]) == pytest.approx(error_m, abs=2e-5)
    assert (rows[0]["frame"], rows[0]["tree"], rows[0]["caliper_line"]) == ("f0", "1", "2")
    inside = sum(int(row["diameter_within95"]) for row in rows)
    assert inside == record["quantities"]["diameter_m"]["coverage"]["count"]
    assert rows[0]["dbh_failure"] == "the stem is not seen at breast height"


def test_a_terminal_shows_the_reasons_of_the_verdict_once(
    run_cli: Cli, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_tables(folder, 6, factor=1.0)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    done = run_cli(*CHECK)
    assert "result: undecided: diameter: 6 stems are too few to tell" in done.out
    assert done.err.splitlines()[-1].endswith(
        "the check is undecided, nothing wrong was found so far: see above"
    )


def test_few_stems_are_undecided_and_without_a_fit(run_cli: Cli, folder: Path) -> None:
    write_tables(folder, 6, factor=1.0)
    done = run_cli(*CHECK, "--out", "out")
    assert done.code == 3, done.err
    assert "not fitted: a fit needs 20 stems with a measured diameter, there are 6" in done.out
    assert "result: undecided: diameter: 6 stems are too few to tell" in done.out
    assert "undecided, nothing wrong was found so far: diameter: 6 stems" in done.err
    saved = json.loads(Path("out/settings.json").read_text())
    assert saved["settings"] == {}
    assert saved["reason"].startswith("a fit needs 20")


def test_stems_are_matched_by_position_within_the_limit(run_cli: Cli, folder: Path) -> None:
    write_tables(folder, 4, factor=1.0)
    (folder / "caliper.csv").write_text("x_m,z_m,diameter_cm\n0.3,4,30\n2,4.6,30\n")
    done = run_cli(*CHECK)
    assert "1 stem matched by position in the camera's frame, within 0.5 m" in done.out
    assert "caliper readings without a measured stem (1): line 3" in done.out
    assert "2 stems matched" in run_cli(*CHECK, "--max-distance", 0.7).out


def test_circumferences_are_noticed(run_cli: Cli, folder: Path) -> None:
    rows = [line.split(";") for line in (folder / "caliper.csv").read_text("utf-8-sig").split()]
    assert len(rows) > 10
    text = "\n".join(
        f"{row[0]};{row[1]};{3.1416 * float(row[2].replace(',', '.')):.1f}" for row in rows[3:]
    )
    (folder / "caliper.csv").write_text(f"frame;tree;diameter_cm\n{text}\n")
    done = run_cli(*CHECK)
    assert done.code == 1
    assert re.search(r"measured values are typically 0\.3\d? times the", done.out)
    assert "not circumferences?" in done.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("caliper.csv", "trees.csv"), "caliper.csv has no column diameter_m: expected the table"),
        (("trees.csv", "none.csv"), "none.csv: no such file"),
        (("trees.csv", "caliper.csv", "--max-distance", 0), "--max-distance is 0.0: expected met"),
        (
            ("trees.csv", "caliper.csv", "--max-distance", 0.3),
            "--max-distance is 0.3: caliper.csv numbers its stems in the column tree",
        ),
        (("trees.csv", "trees.csv"), "trees.csv is a machine's table: expected the readings"),
        (("trees.csv", "empty.csv"), "empty.csv: the first line has fewer than two columns"),
        (("trees.csv", "caliper.csv", "--out", "trees.csv"), "output folder trees.csv cannot be"),
    ],
)
def test_a_mistake_is_one_line(
    run_cli: Cli, folder: Path, arguments: tuple[object, ...], message: str
) -> None:
    (folder / "empty.csv").write_text("")
    done = run_cli("check", *arguments)
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("edgetree: ")
    assert len(done.err.splitlines()) == 1
    assert message in done.err


def test_the_output_does_not_overwrite_an_input(run_cli: Cli, folder: Path) -> None:
    (folder / "trees.csv").rename(folder / "matched.csv")
    before = (folder / "matched.csv").read_bytes()
    done = run_cli("check", "matched.csv", "caliper.csv", "--out", ".")
    assert done.code == 2
    assert "matched.csv, which is MEASURED.csv matched.csv too: expected another path" in done.err
    assert (folder / "matched.csv").read_bytes() == before


def test_a_plot_of_an_earlier_check_does_not_stay(run_cli: Cli, folder: Path) -> None:
    run_cli(*CHECK, "--out", "out")
    Path("out/dbh.png").write_bytes(Path("out/diameter.png").read_bytes())
    Path("out/notes.png").touch()
    assert run_cli(*CHECK, "--out", "out").code == 0
    assert sorted(path.name for path in Path("out").iterdir()) == [
        "diameter.png", "matched.csv", "notes.png", "settings.json"
    ]  # fmt: skip


def test_one_stem_is_told_how_many_more_are_needed(run_cli: Cli, folder: Path) -> None:
    write_tables(folder, 1, factor=1.0)
    done = run_cli(*CHECK)
    assert done.code == 3
    found = re.search(r"1 stem is too few to tell: .*; measure about (\d+) stems", done.out)
    assert found, done.out
    assert 5 <= int(found[1]) <= 50
    assert "10000" not in done.out
