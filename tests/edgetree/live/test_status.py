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


def test_gaps_are_not_in_the_rate_nor_in_what_is_slow(clock: list[float]) -> None:
    recorder = StatusRecorder()
    add(recorder, clock, 60, 1 / 15)
    clock[0] += 600.0
    add(recorder, clock, 10, 1 / 15)
    found = recorder.status(0, {})
    assert (found.rate_hz, found.slow_frame_s) == (pytest.approx(15), pytest.approx(1 / 15))


@pytest.mark.parametrize("parts", [(5, 3), (3, 5), (5, 5, 5)])
def test_gaps_among_the_first_results_hide_no_silence(
    clock: list[float], parts: tuple[int, ...]
) -> None:
    recorder = StatusRecorder()
    for count in parts:
        add(recorder, clock, count, 0.1)
        clock[0] += 600.0
    found = recorder.status(0, {})
    assert (found.rate_hz, found.slow_frame_s) == (pytest.approx(10), pytest.approx(0.1))


def test_a_slow_camera_has_its_rate(clock: list[float]) -> None:
    recorder = StatusRecorder()
    add(recorder, clock, 20, 10.0)
    add(recorder, clock, 1, 300.0)
    found = recorder.status(0, {})
    assert (found.rate_hz, found.slow_frame_s) == (pytest.approx(0.1), pytest.approx(10.0))


def test_pauses_of_a_source_that_comes_in_bursts_are_usual(clock: list[float]) -> None:
    recorder = StatusRecorder()
    for _ in range(8):
        add(recorder, clock, 3, 0.1)
        clock[0] += 5.0
    found = recorder.status(0, {})
    assert found.slow_frame_s == pytest.approx(5.1)
    assert 0.5 < found.rate_hz < 1.0
