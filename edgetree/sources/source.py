"""What all sources of frames have in common."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Final, Protocol

from basetree.errors import InputError, Unavailable
from edgetree.frames.frame import Frame

DEPTH_PLACED_BY_GUESS: Final = "depth registered without a transform"
"""Name in `FrameSource.counts`: the place of the depth camera was not known."""

REMARKS: Final = frozenset(
    {
        "without pose",
        "without gravity",
        "depth not aligned",
        DEPTH_PLACED_BY_GUESS,
        "IMU samples out of range",
        "transforms that are no rotation",
        "end missing",
        "files empty",
        "files missing",
        "ended early",
        "broken video frames",
    }
)
"""Names in `FrameSource.counts` that are remarks, on frames that were used or on the source."""

INCOMPLETE: Final = frozenset(
    {"end missing", "files empty", "files missing", "ended early", "broken video frames"}
)
"""Remarks on a source of which a part could not be read."""


class FrameSource(Protocol):
    """Files, a recording or a camera. Iterate over it once; `close` may be called at any time."""

    @property
    def name(self) -> str:
        """What messages call it, such as the path or the address."""

    @property
    def count(self) -> int | None:
        """Number of frames; None if it is not known in advance."""

    @property
    def is_live(self) -> bool:
        """Whether frames that are not taken in time are lost, as of a camera."""

    @property
    def counts(self) -> dict[str, int]:
        """What was left out so far, such as {"colour without depth": 3}, and `REMARKS`."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames.

        Raises:
            SourceLost: The camera does not answer any more. It may be opened again.
            InputError: The source cannot be read. Image files raise it for a frame that cannot be
                read, and then go on with the next one.
        """

    def close(self) -> None:
        """Release the camera or the file; an iteration in progress ends."""


class SourceLost(Unavailable):
    """A camera does not answer any more."""


class BaseSource:
    """A source whose iteration ends after it is closed.

    Args:
        name: What messages call it.
    """

    is_live = False
    count: int | None = None

    def __init__(self, name: str) -> None:
        self.name = name
        self.counts = Counter[str]()
        self._is_closed = threading.Event()

    def close(self) -> None:
        """End an iteration in progress."""
        self._is_closed.set()


def readable(frames: Iterable[Frame], on_error: Callable[[Exception], None]) -> Iterator[Frame]:
    """Yield the frames that can be read.

    Args:
        frames: The frames.
        on_error: Called with the error of each frame that cannot be read.
    """
    iterator = iter(frames)
    while True:
        try:
            frame = next(iterator)
        except StopIteration:
            return
        except InputError as error:
            on_error(error)
            continue
        yield frame
