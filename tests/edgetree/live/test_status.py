"""What a live pipeline counts."""

from __future__ import annotations

import pytest

from edgetree.live import status
from edgetree.live.status import StatusRecorder


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time that the recorder sees, s; add to its only element."""
    now_s = [1000.0]
    monkeypatch.setattr(status.time, "monotonic", lambda: now_s[0])
    return now_s


def add(recorder: StatusRecorder, clock: list[float], count: int, step_s: float) -> None:
    for _ in range(count):
        clock[0] += step_s
        recorder.add({"detect": 20.0}, 0.05)


def test_reasons_that_differ_in_numbers_alone_are_one() -> None:
    recorder = StatusRecorder()
    counts = [recorder.leave_out(f"the vertical is (0.{n}, 1, 0): upside down") for n in range(50)]
    assert counts == list(range(1, 51))
    assert recorder.leave_out("without depth images") == 1
    left_out = recorder.status(0, {}).left_out
    assert left_out == {"the vertical is (0.0, 1, 0): upside down": 50, "without depth images": 1}


def test_reasons_without_end_are_counted_together() -> None:
    recorder = StatusRecorder()
    words = [f"no {chr(97 + n // 26)}{chr(97 + n % 26)}" for n in range(500)]
    for word in words:
        recorder.leave_out(word)
    left_out = recorder.status(0, {}).left_out
    assert len(left_out) < 50
    assert sum(left_out.values()) == 500
    assert left_out["other reasons"] > 400


def test_the_rate_is_that_since_the_last_gap(clock: list[float]) -> None:
    recorder = StatusRecorder()
    add(recorder, clock, 60, 1 / 15)
    assert recorder.status(0, {}).rate_hz == pytest.approx(15)
    clock[0] += 600.0
    add(recorder, clock, 10, 1 / 15)
    assert recorder.status(0, {}).rate_hz == pytest.approx(15)


def test_a_slow_camera_has_its_rate(clock: list[float]) -> None:
    recorder = StatusRecorder()
    add(recorder, clock, 5, 10.0)
    assert recorder.status(0, {}).rate_hz == pytest.approx(0.1)
    add(recorder, clock, 1, 30.0)
    assert recorder.status(0, {}).rate_hz == pytest.approx(5 / 70)
