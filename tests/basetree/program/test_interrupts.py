"""Ctrl-C, SIGTERM and SIGHUP wait for the end of a block."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from types import FrameType

import pytest

from basetree.program.interrupts import interrupt_afterwards

SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]


def end(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt(number)


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """Handlers of a command line, whatever the parent of the tests ignores."""
    before = {number: signal.signal(number, end) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def send(number: int, times: int, done: list[str]) -> None:
    with interrupt_afterwards():
        for _ in range(times):
            signal.raise_signal(number)
        done.append("step")


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_waits_for_the_end_and_a_second_one_does_not(number: signal.Signals) -> None:
    done: list[str] = []
    for times in (1, 2):
        with pytest.raises(KeyboardInterrupt, match=str(int(number))):
            send(number, times, done)
        assert done == ["step"]
    assert signal.getsignal(number) is end


def test_ignored_signals_stay_ignored() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    done: list[str] = []
    send(signal.SIGINT, 2, done)
    assert done == ["step"]
    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def test_an_interrupt_at_any_place_leaves_handlers_that_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also one at the very end of the block, while the handlers are put back."""
    usual, set_ = [], signal.signal

    def signal_amid(number: int, handler: object) -> object:
        usual.append(number)
        before = set_(number, handler)  # type: ignore[arg-type]
        if len(usual) == len(SIGNALS) + 1:  # the first one that is put back
            signal.raise_signal(number)
        return before

    monkeypatch.setattr(signal, "signal", signal_amid)
    with pytest.raises(KeyboardInterrupt), interrupt_afterwards():
        pass
    for number in SIGNALS:
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
