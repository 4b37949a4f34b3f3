"""What is told about a job while it runs: rate, cost and time left."""

import pytest

from basetree.jobs import Progress


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time in seconds, which a test sets."""
    now = [100.0]
    monkeypatch.setattr("basetree.jobs.progress.time.monotonic", lambda: now[0])
    return now


def test_rate_cost_and_time_left(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress("simulating", cores=2)
    progress.begin(1000, 400)
    clock[0] += 120
    progress.add(100, 90.0)
    assert capsys.readouterr().err.splitlines() == [
        "400 of 1000 frames are finished from an earlier run",
        "simulating: 500 of 1000 frames, 50 frames/min, 0.5 core-hours per 1,000 frames,"
        " 10 min left",
    ]


def test_lines_come_once_a_minute_and_at_the_end(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    progress = Progress("detecting")
    progress.begin(30, 0)
    for _ in range(30):
        clock[0] += 5
        progress.add(1, 5.0)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    assert lines[-1].startswith("detecting: 30 of 30 frames, 12 frames/min")
    assert "left" not in lines[-1]


def test_nothing_is_told_if_it_is_not_shown(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    progress = Progress("detecting", shown=False)
    progress.begin(2, 1)
    progress.add(1, 1.0)
    assert capsys.readouterr().err == ""
