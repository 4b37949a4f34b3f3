"""Two results compared: a slower model is found, noise is not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from bench_results import ACCURACY, result_of, row_of

from basetree.errors import InputError
from basetree.files.json import build
from edgetree.bench.compare import ResultChange, compare_results
from edgetree.bench.stored import StoredResult


def timed(*rounds_ms: float, **changes: Any) -> Any:
    """A result of one row with these medians of its rounds."""
    return result_of([row_of(rounds=[{"p50_ms": each} for each in rounds_ms], **changes)])


def compare(old: Any, new: Any) -> ResultChange:
    """Compare two results as they are stored."""
    return compare_results(build(StoredResult, old, "old"), build(StoredResult, new, "new"))


def test_the_same_times_are_no_regression() -> None:
    found = compare(timed(20.0, 20.4, 19.8), timed(20.2, 19.9, 20.3))
    assert found.regressions == ()
    assert not found.rows[0].faster


def test_a_slower_model_is_a_regression_and_a_faster_one_is_not() -> None:
    before, slower = timed(20.0, 20.4, 19.8), timed(22.0, 22.4, 21.9)
    (row,) = compare(before, slower).regressions
    assert row.ratio == pytest.approx(1.1)
    back = compare(slower, before)
    assert back.regressions == ()
    assert back.rows[0].faster


def test_noise_of_either_result_hides_a_change_of_its_size() -> None:
    noisy = timed(20.0, 26.0, 18.0)
    assert compare(noisy, timed(22.0, 22.4, 21.9)).regressions == ()
    assert compare(timed(20.0, 20.4, 19.8), timed(22.0, 26.0, 20.5)).regressions == ()
    assert compare(noisy, timed(40.0, 40.1, 40.2)).regressions != ()


def test_one_disturbed_round_is_no_noise() -> None:
    disturbed = timed(20.0, 20.1, 20.2, 19.9, 35.0)
    (row,) = compare(disturbed, timed(21.5, 21.6, 21.4, 21.5, 21.6)).regressions
    assert row.noise < 0.05


def test_small_changes_do_not_count_however_little_noise_there_is() -> None:
    assert compare(timed(20.0, 20.0), timed(20.5, 20.5)).regressions == ()
    assert compare(timed(20.0, 20.0), timed(20.7, 20.7)).regressions != ()


def test_lost_accuracy_on_the_same_frames_is_a_regression() -> None:
    worse = {**ACCURACY, "box_ap": 57.9}
    (row,) = compare(timed(20.0, accuracy=ACCURACY), timed(20.0, accuracy=worse)).rows
    assert row.regressed
    assert row.lost_ap == {"box_ap": 0.44}
    other = {**worse, "frames": "other frames"}
    found = compare(timed(20.0, accuracy=ACCURACY), timed(20.0, accuracy=other))
    assert not found.rows[0].regressed
    (line,) = found.lines()
    assert line.endswith("not compared: of 400 frames of the preset test, then of other frames")
    (line,) = compare(timed(20.0, accuracy=ACCURACY), timed(20.0)).lines()
    assert line.endswith("accuracy not compared: of 400 frames of the preset test, then not known")


def test_the_date_of_a_card_does_not_keep_accuracy_from_being_compared() -> None:
    frames = "400 frames of the preset test"
    before = {**ACCURACY, "frames": f"{frames}, 2026-11-24"}
    worse = {**ACCURACY, "box_ap": 1.0, "frames": frames}
    (row,) = compare(timed(20.0, accuracy=before), timed(20.0, accuracy=worse)).rows
    assert row.regressed


def test_a_row_that_is_there_twice_is_refused() -> None:
    twice = result_of([row_of("a", rounds=[{"p50_ms": 40.0}]), row_of("a")])
    with pytest.raises(InputError, match="NEW has 2 rows of a float32"):
        compare(result_of([row_of("a")]), twice)


def test_rows_belong_together_by_how_they_ran() -> None:
    old = result_of([row_of("a"), row_of("a", threads=1), row_of("b")])
    new = result_of([row_of("a"), row_of("a", batch=4)])
    found = compare(old, new)
    assert [row.row for row in found.rows] == ["a float32 800x800 cpu, 2 threads, batch 1"]
    assert len(found.only_old) == 2
    assert found.only_new == ("a float32 800x800 cpu, 2 threads, batch 4",)
    with pytest.raises(InputError, match="no row in common"):
        compare(result_of([row_of("a")]), result_of([row_of("c")]))


def test_another_machine_is_said() -> None:
    other = timed(20.0)
    other["environment"]["processor"] = "another"
    lines = list(compare(timed(20.0), other).lines())
    assert lines[0] == "measured on different machines: a processor, 2 cores, then another, 2 cores"
    other["environment"]["processor"] = None
    lines = list(compare(timed(20.0), other).lines())
    assert lines[0].endswith("then processor not known, 2 cores")


def test_the_command_ends_with_1_for_a_regression(run_cli: Any, tmp_path: Path) -> None:
    files = {name: tmp_path / f"{name}.json" for name in ("old", "new")}
    files["old"].write_text(json.dumps(timed(20.0, 20.1)))
    files["new"].write_text(json.dumps(timed(30.0, 30.1)))
    done = run_cli("compare", files["old"], files["new"])
    assert done.code == 1
    assert "SLOWER" in done.out
    assert done.err.splitlines()[-1] == "edgetree: 1 of 1 row became worse"
    done = run_cli("compare", files["new"], files["old"], "--json")
    assert done.code == 0
    assert json.loads(done.out)["rows"][0]["faster"]
