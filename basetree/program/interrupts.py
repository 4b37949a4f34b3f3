"""Delay interrupts, so that what belongs together is done together."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interrupt_afterwards() -> Iterator[None]:
    """Delay Ctrl-C, SIGTERM and SIGHUP to the end of the block; a second one interrupts at once.

    Signals that end the process without a handler are not delayed. Has no effect outside the main
    thread, where Python delivers no signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    numbers = (getattr(signal, name, None) for name in ("SIGINT", "SIGTERM", "SIGHUP"))
    found = {number: signal.getsignal(number) for number in numbers if number is not None}
    handlers = {number: handler for number, handler in found.items() if callable(handler)}
    is_over = False

    def remember(number: int, frame: FrameType | None) -> None:
        if not is_over:
            received.append(number)
        if is_over or len(received) > 1:
            handlers[signal.Signals(number)](number, frame)

    try:
        for number in handlers:
            signal.signal(number, remember)
        yield
    finally:
        is_over = True  # one that interrupts the next lines leaves handlers that delay nothing
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if received:
        handlers[signal.Signals(received[0])](received[0], None)
