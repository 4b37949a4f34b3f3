"""The newest result for all clients. Nothing is queued, and publishing never waits."""

from __future__ import annotations

import threading
import time
from collections import deque
from concurrent.futures import CancelledError, ThreadPoolExecutor
from dataclasses import asdict
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

from edgetree.drawing.primitives import Picture
from edgetree.live.page.pictures import draw_result, encode_jpeg
from edgetree.live.page.records import page_record
from edgetree.live.results import LiveResult

if TYPE_CHECKING:
    from edgetree.live.health import ServiceHealth
    from edgetree.live.recording import FrameRecorder

_RATE_SPAN_S: Final = 2.0
_POLL_S: Final = 0.02  # clients look this often, so that the publisher need not wake them


class Drawing:
    """One thread that draws and encodes the pictures for all clients.

    The C library keeps memory apart for each thread that asks for some: were the pictures drawn in
    the threads of the clients, each would keep some MiB.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, "page-drawing")

    def jpeg(self, result: LiveResult, picture: Picture | None) -> bytes:
        """The JPEG of a result, on a picture of its own or with the trees drawn.

        Raises:
            ConnectionAbortedError: The page is closed.
        """
        try:
            drawn = self._thread.submit(_jpeg_of, result, picture)
        except RuntimeError as error:
            raise ConnectionAbortedError("the page is closed") from error
        try:
            return drawn.result()
        except CancelledError as error:
            raise ConnectionAbortedError("the page is closed") from error

    def close(self) -> None:
        """Draw no more."""
        self._thread.shutdown(wait=False, cancel_futures=True)


def _jpeg_of(result: LiveResult, picture: Picture | None) -> bytes:
    return encode_jpeg(draw_result(result) if picture is None else picture)


class Shown:
    """A published result. Its record and its JPEG are made once, when a client first asks.

    Attributes:
        serial: Number of the result, from 1 on.
        taken_s: When its frame arrived, s of `time.monotonic`.
        rate_hz: Results per second around it; None for the first.
    """

    def __init__(
        self,
        serial: int,
        result: LiveResult,
        picture: Picture | None,
        taken_s: float,
        rate_hz: float | None,
        drawing: Drawing,
    ) -> None:
        self.serial, self.taken_s, self.rate_hz = serial, taken_s, rate_hz
        self._result, self._picture, self._drawing = result, picture, drawing
        self._jpeg: bytes | None = None
        self._lock = threading.Lock()

    def record(self) -> dict[str, Any]:
        """The stems and rates, see `page_record`."""
        with self._lock:
            return self._record

    def jpeg(self) -> bytes:
        """The picture with the trees drawn."""
        with self._lock:
            if self._jpeg is None:
                self._jpeg = self._drawing.jpeg(self._result, self._picture)
            return self._jpeg

    @cached_property
    def _record(self) -> dict[str, Any]:
        rate_hz = None if self.rate_hz is None else round(self.rate_hz, 1)
        return {**page_record(self._result), "serial": self.serial, "rate_hz": rate_hz}


class Feed:
    """Holds the newest result.

    Args:
        stale_s: Age from which a result is too old to be shown, s.
        recorder: Records what clients mark; None if recording is off.
        health: Says how the service goes; None if nothing is watched.
    """

    def __init__(
        self,
        stale_s: float,
        recorder: FrameRecorder | None = None,
        health: ServiceHealth | None = None,
    ) -> None:
        self.stale_s, self.recorder, self.health = stale_s, recorder, health
        self._newest: Shown | None = None
        self._closed = False
        self._drawing = Drawing()
        self._times_s: deque[float] = deque(maxlen=240)

    @property
    def newest(self) -> Shown | None:
        """The newest result, old or not."""
        return self._newest

    @property
    def closed(self) -> bool:
        """Whether clients should leave."""
        return self._closed

    def put(self, result: LiveResult, picture: Picture | None) -> None:
        """Replace the newest result. Takes no lock; call it from one thread."""
        now_s = time.monotonic()
        serial = 1 if self._newest is None else self._newest.serial + 1
        taken_s, rate_hz = now_s - result.age_s, self._rate_hz(now_s)
        self._newest = Shown(serial, result, picture, taken_s, rate_hz, self._drawing)

    def wait(self, after: int, timeout_s: float) -> Shown | None:
        """Wait for a result with a serial above `after`; None if there is none in time."""
        end_s = time.monotonic() + timeout_s
        while not self._closed:
            newest = self._newest
            if newest is not None and newest.serial > after:
                return newest
            if time.monotonic() >= end_s:
                break
            time.sleep(_POLL_S)
        return None

    def is_stale(self, shown: Shown) -> bool:
        """Whether a result is too old to be shown."""
        return time.monotonic() - shown.taken_s > self.stale_s

    def status(self) -> dict[str, Any]:
        """State and clock, sent with every event: the page computes the ages from them."""
        newest, now_s = self._newest, time.monotonic()
        state = "waiting" if newest is None else "stale" if self.is_stale(newest) else "live"
        taken_s = None if newest is None else round(newest.taken_s, 4)
        return {
            "state": state,
            "clock_s": round(now_s, 4),
            "taken_s": taken_s,
            "stale_s": self.stale_s,
            "recordings": None if self.recorder is None else asdict(self.recorder.status),
        }

    def close(self) -> None:
        """Tell all clients to leave."""
        self._closed = True
        self._drawing.close()

    def _rate_hz(self, now_s: float) -> float | None:
        times_s = self._times_s
        times_s.append(now_s)
        while now_s - times_s[0] > _RATE_SPAN_S and len(times_s) > 2:
            times_s.popleft()
        if len(times_s) < 2 or now_s == times_s[0]:
            return None
        return (len(times_s) - 1) / (now_s - times_s[0])
