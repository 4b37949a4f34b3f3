"""Time stamps that go on rising."""

from __future__ import annotations

import pytest

from edgetree.sources.playing import RisingClock


@pytest.mark.parametrize("wrong_s", [4e9, 0.0])
def test_one_wrong_stamp_does_not_move_the_others_far(wrong_s: float) -> None:
    clock, start_s = RisingClock(), 1.7e9
    stamps = (start_s, start_s + 0.1, wrong_s, start_s + 0.3, start_s + 0.4)
    rising = [clock.rising_s(stamp) - start_s for stamp in stamps]
    assert rising == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4], abs=1e-5)


def test_a_pause_is_kept() -> None:
    clock = RisingClock()
    assert [clock.rising_s(stamp) for stamp in (10.0, 10.1, 7210.1)] == [10.0, 10.1, 7210.1]
