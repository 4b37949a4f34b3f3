"""What is handed over between threads, also when the one that takes is interrupted."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Iterator

import pytest
from interrupted import interrupted_at

from edgetree.sources.pushed import Handover

PATIENCE_S = 20.0


@pytest.fixture(autouse=True)
def handler() -> Iterator[None]:
    """The handler of Python, whatever the parent of the tests ignores."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def ends(handover: Handover[int]) -> bool:
    """Whether another thread can end the exchange."""
    ending = threading.Thread(target=handover.end, daemon=True)
    ending.start()
    ending.join(PATIENCE_S)
    return not ending.is_alive()


def test_every_value_is_taken_in_order_and_then_the_error() -> None:
    handover: Handover[int] = Handover()

    def put() -> None:
        for number in range(1000):
            assert handover.put(number)
        handover.end(ValueError("the end"))

    threading.Thread(target=put, daemon=True).start()
    numbers = iter(handover)
    assert [next(numbers) for _ in range(1000)] == list(range(1000))
    with pytest.raises(ValueError, match="the end"):
        next(numbers)
    assert not handover.put(0)


@pytest.mark.parametrize("newest_only", [False, True])
def test_a_service_that_runs_for_months_needs_no_more_memory(newest_only: bool) -> None:
    handover: Handover[int] = Handover(newest_only=newest_only)
    values = iter(handover)

    def pass_on(count: int) -> None:
        for number in range(count):
            assert handover.put(number)
            assert next(values) == number

    pass_on(100)
    tracemalloc.start()
    try:
        pass_on(50_000)
        grown_bytes, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert grown_bytes < 20_000


def test_an_interrupt_at_any_place_leaves_no_lock_locked() -> None:
    place = 0
    while _is_interrupted_at(place):
        place += 1
    assert place > 10


def _is_interrupted_at(place: int) -> bool:
    """Interrupt the thread that takes; returns whether there was such a place."""
    handover: Handover[int] = Handover()

    def put() -> None:
        handover.put(0)
        time.sleep(0.01)
        handover.put(1)

    def take() -> None:
        numbers = iter(handover)
        assert (next(numbers), next(numbers)) == (0, 1)

    threading.Thread(target=put, daemon=True).start()
    modules = ("edgetree.sources.pushed", "threading", "queue", "contextlib")
    is_interrupted = interrupted_at(place, take, *modules)
    assert ends(handover), f"interrupted at place {place}"
    return is_interrupted


# An interrupt that comes too late must not reach the tests, so this runs in a process of its own.
WAITING = f"""
import signal, sys, threading, time
from edgetree.sources.pushed import Handover

signal.signal(signal.SIGINT, signal.default_int_handler)
handover = Handover()

def interrupt():
    time.sleep(0.05)
    signal.pthread_kill(threading.get_ident(), signal.SIGINT)
    time.sleep({PATIENCE_S})
    handover.end()

try:
    threading.Thread(target=interrupt, daemon=True).start()
    list(handover)
except KeyboardInterrupt:
    sys.exit(3)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals of threads")
def test_a_wait_ends_by_a_signal_that_another_thread_got() -> None:
    """The system may choose any thread; the main one goes on to wait where it is not woken."""
    done = subprocess.run([sys.executable, "-c", WAITING], check=False, timeout=120)
    assert done.returncode == 3
