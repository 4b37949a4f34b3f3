"""Tests of `edgetree demo`."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from schema_check import check_schema

TIME_LIMIT_S = 60
MEMORY_LIMIT_MIB = 1024


def run_demo(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    code = "from edgetree.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, "demo", *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        timeout=5 * TIME_LIMIT_S,
    )


@pytest.fixture(scope="module")
def demo_json(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict, Path, str]:
    """JSON output, folder and stderr of one run with the packaged models."""
    folder = tmp_path_factory.mktemp("demo")
    done = run_demo("--json", "--out", "made", cwd=folder)
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    return json.loads(line), folder, done.stderr


def test_the_json_names_an_existing_report(demo_json: tuple[dict, Path, str]) -> None:
    data, folder, _ = demo_json
    assert check_schema(data) == "edgetree.demo/1"
    assert data["report"] == str(Path("made/report.html"))
    assert [path.name for path in (folder / "made").iterdir()] == ["report.html"]
    assert (folder / data["report"]).read_text("utf-8").count("data:image/jpeg") == 12


def test_the_end_is_told_at_most_once(demo_json: tuple[dict, Path, str]) -> None:
    assert demo_json[2].count("done") <= 1


def test_the_packaged_models_find_and_measure_most_sample_trees(
    demo_json: tuple[dict, Path, str],
) -> None:
    data, _, _ = demo_json
    assert set(data["models"]) == {"depth", "rgb"}
    for model in data["models"].values():
        trees = model["trees"]
        assert {tree["frame"] for tree in trees} == {f"sample_{n}" for n in range(6)}
        assert all(0.05 < tree["true_diameter_m"] < 1.0 for tree in trees)
        assert model["found_trees"] >= 0.5 * len(trees)
        assert model["unmatched_detections"] <= len(trees)
        assert model["fps_p50"] > 1.0
    depth = data["models"]["depth"]
    assert depth["errors"]["diameter_m"]["measured"] >= 0.5 * depth["found_trees"]
    assert depth["errors"]["diameter_m"]["median_abs_error_m"] < 0.06
    assert depth["errors"]["distance_m"]["median_abs_error_m"] < 0.5


def test_it_stays_within_its_limits(demo_json: tuple[dict, Path, str]) -> None:
    data, _, _ = demo_json
    assert data["duration_s"] < TIME_LIMIT_S
    assert data["peak_memory_mib"] < MEMORY_LIMIT_MIB


def test_progress_and_summary_go_to_stderr(demo_json: tuple[dict, Path, str]) -> None:
    _, _, stderr = demo_json
    assert "measuring sample_0" in stderr
    assert "trees found" in stderr


def test_a_folder_that_cannot_be_made_is_one_line_and_exit_code_2(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    done = run_demo("--out", "taken", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("edgetree: output folder taken cannot be written")
    assert (tmp_path / "taken").read_text() == "a file"
