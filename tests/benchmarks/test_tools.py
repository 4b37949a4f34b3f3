"""What the programs share."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.tools.processes import Usage, memory_mib, percentiles
from benchmarks.tools.program import finish, made_once, read_record
from benchmarks.tools.timing import in_turn, medians


def test_calls_are_timed_in_turn_and_the_warm_up_does_not_count() -> None:
    called: list[tuple[str, int]] = []
    times = in_turn(
        {name: lambda number, name=name: called.append((name, number)) for name in "ab"},
        rounds=2,
        warm_up=1,
    )
    assert called == [("a", 0), ("b", 0), ("a", 1), ("b", 1), ("a", 2), ("b", 2)]
    assert {name: len(each) for name, each in times.items()} == {"a": 2, "b": 2}
    assert medians([{"x": 1.0}, {"x": 9.0}, {"x": 2.0}]) == {"x": 2.0}


def test_a_record_is_made_once(tmp_path: Path) -> None:
    path, made = tmp_path / "scores.json", []
    for _ in range(2):
        assert made_once(path, lambda: made.append(1) or {"ap": 50.0}) == {"ap": 50.0}
    assert len(made) == 1


def test_a_result_is_printed_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert read_record(tmp_path / "none.json") == {}
    finish({"machine": "x"}, tmp_path / "result.json")
    assert json.loads(capsys.readouterr().out) == read_record(tmp_path / "result.json")


def test_open_files_that_grow_are_seen(tmp_path: Path) -> None:
    usage, files = Usage(40), []
    for number in range(40):
        if number >= 20:
            files.append((tmp_path / str(number)).open("w"))
        usage.look(float(number))
    for file in files:
        file.close()
    handles, grown = usage.handles()
    assert grown
    assert handles["open_files"][1] - handles["open_files"][0] == 20
    assert usage.resident_mib.min() > 1


def test_the_memory_of_a_process_that_has_ended_is_nothing() -> None:
    assert memory_mib("self", "status", "VmHWM") > 1
    assert memory_mib(2**22 + 1, "status", "VmHWM") == 0.0


def test_percentiles_are_those_of_each_part() -> None:
    found = percentiles(np.array([1.0, 3.0, 10.0, 30.0]), np.array([0, 0, 1, 1]), 1)
    assert found["p50"] == [2.0, 20.0]
