"""The progress of long steps: rate and time left, on a terminal and in plain lines."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable

import pytest

from basetree.program import console
from basetree.program.console import TALK, StatusLine, note
from basetree.program.progress import Progress, counter, duration, steps_shown, track


class Screen(io.StringIO):
    """A stderr that counts as a terminal or not."""

    def __init__(self, terminal: bool) -> None:
        super().__init__()
        self.terminal = terminal

    def isatty(self) -> bool:
        return self.terminal


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], Screen]:
    def make(terminal: bool) -> Screen:
        made = Screen(terminal)
        monkeypatch.setattr(sys, "stderr", made)
        monkeypatch.setattr(StatusLine, "_standing", None)
        return made

    return make


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time in seconds, which a test sets."""
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    return now


def test_plain_lines_begin_after_five_seconds_and_come_once_a_minute(
    screen: Callable[[bool], Screen], clock: list[float]
) -> None:
    seen = screen(False)
    step = Progress("simulating", 1000, done=100)
    for _ in range(300):
        clock[0] += 1
        step.update(2)
    step.end()
    lines = seen.getvalue().splitlines()
    assert lines[0] == "simulating: 110 of 1000 frames, 2.0 frames/s, 7 min left"
    assert len(lines) == 6
    assert lines[-1].startswith("simulating: 700 of 1000 frames, 2.0 frames/s")


def test_a_short_step_says_nothing(screen: Callable[[bool], Screen], clock: list[float]) -> None:
    seen = screen(False)
    assert list(track(range(3), "detecting", 3)) == [0, 1, 2]
    assert seen.getvalue() == ""


def test_a_terminal_has_one_line_of_its_width_that_notes_do_not_break(
    screen: Callable[[bool], Screen], clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "30")
    seen = screen(True)
    step = Progress("simulating", 1000)
    clock[0] += 1
    step.update(1)
    note("beside it")
    clock[0] += 1
    step.update(999)
    step.end()
    shown = seen.getvalue().split(console._ERASE)
    assert shown[1] == "simulating: 1 of 1000 frames,"
    assert shown[2] == "beside it\n"
    assert shown[-1].startswith("simulating: 1000 of 1000")
    assert max(len(line.rstrip("\n")) for line in shown) < 30


def test_while_nothing_is_finished_the_time_so_far_is_shown(
    screen: Callable[[bool], Screen], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "_FIRST_LINE_S", 0.0)
    seen = screen(False)
    with steps_shown("reading") as say:
        say("tracing the graph")
        time.sleep(0.7)
    assert "tracing the graph, 0 s so far" in seen.getvalue()


def test_slow_steps_count_by_the_minute(clock: list[float]) -> None:
    step = Progress("training", 10, "run")
    clock[0] += 120
    step.update(1)
    assert step.text() == "training: 1 of 10 runs, 0.5 a minute, 18 min left"


def test_a_counter_begins_anew(screen: Callable[[bool], Screen], clock: list[float]) -> None:
    seen = screen(False)
    tell = counter("caching")
    for done in (0, 5, 10, 4, 10):
        clock[0] += 6
        tell(done, 10)
    lines = seen.getvalue().splitlines()
    assert [line.partition(",")[0] for line in lines] == [
        "caching: 5 of 10 frames",
        "caching: 10 of 10 frames",
        "caching: 10 of 10 frames",
        "caching: 10 of 10 frames",
    ]


def test_a_quiet_program_shows_no_progress(
    screen: Callable[[bool], Screen], clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TALK, "quiet", True)
    seen = screen(True)
    step = Progress("simulating", 10)
    clock[0] += 100
    step.update(1)
    assert seen.getvalue() == ""


def test_durations_are_for_people() -> None:
    assert [duration(s) for s in (12, 89, 600, 7200)] == ["12 s", "89 s", "10 min", "2.0 h"]
