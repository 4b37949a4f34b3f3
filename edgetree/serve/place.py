"""The place of the program that hands frames over, and the frames that wait for their answer."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from numpy.typing import NDArray

from edgetree.serve.handed import HandedFrame, inline_pixels
from edgetree.serve.messages import FrameMessage
from edgetree.serve.router import Sender
from edgetree.serve.shared_memory import OpenMemories
from edgetree.sources.pushed import Handover

ENDS: Final = "the service ends"
_NEWER: Final = "a newer frame had arrived"


@dataclass(frozen=True)
class Asked:
    """A frame that waits for its answer: who handed it over, and the id that it has there."""

    sender: Sender
    id: int


class HandingPlace:
    """Takes the frames of one program at a time, and hands them to the pipeline.

    All methods but `pop` and `leave_out` are for the thread of the service.

    Args:
        on_left_out: Called with each frame that gets no result, and the reason, from any thread.

    Attributes:
        holder: The program that has the place; None if it is free.
        heard_s: When something last came from the holder or went to it, s of `time.monotonic`.
        frames: Gives the frames of the holder.
    """

    def __init__(self, on_left_out: Callable[[Asked, str], object]) -> None:
        self._on_left_out = on_left_out
        self._asked: dict[int, Asked] = {}
        self._numbers = itertools.count()
        self._memories = OpenMemories()
        self.holder: Sender | None = None
        self.heard_s = 0.0
        self.frames = self._handover()

    def take(
        self, sender: Sender, message: FrameMessage, parts: Sequence[bytes | memoryview]
    ) -> None:
        """Take a frame; its sender holds the place from now on.

        Raises:
            InputError: Its pixels cannot be used.
        """
        colour, depth = self._pixels(message, parts)
        self.holder, self.heard_s = sender, time.monotonic()
        number = next(self._numbers)
        self._asked[number] = Asked(sender, message.id)
        if not self.frames.put(HandedFrame(number, message, colour, depth)):
            self.leave_out(number, ENDS)

    def pop(self, number: int | None) -> Asked | None:
        """Who waits for the answer of a frame; nobody does afterwards."""
        return None if number is None else self._asked.pop(number, None)

    def leave_out(self, number: int | None, reason: str) -> None:
        """A frame gets no result."""
        if (asked := self.pop(number)) is not None:
            self._on_left_out(asked, reason)

    def is_silent(self, longest_s: float) -> bool:
        """Whether its holder is silent for longer, while it waits for no answer."""
        is_silent = time.monotonic() - self.heard_s > longest_s
        return self.holder is not None and is_silent and not self._asked

    def release(self, error: Exception) -> None:
        """Make the place free; the source ends with the error until somebody takes it."""
        self.holder = None
        self._memories.close()
        before, self.frames = self.frames, self._handover()
        before.end(error)
        for number in list(self._asked):  # nobody may come to take the frame that waits
            self.leave_out(number, str(error))

    def end(self) -> None:
        """Leave out the frames that wait, and take no more."""
        for number in list(self._asked):
            self.leave_out(number, ENDS)
        self.frames.end()

    def close(self) -> None:
        """Close the shared memory."""
        self._memories.close()

    def _pixels(
        self, message: FrameMessage, parts: Sequence[bytes | memoryview]
    ) -> list[NDArray[Any] | None]:
        """The colour and depth image, of parts of the message or shared memory."""
        colour, depth = inline_pixels(message, parts)
        if message.colour is not None and message.colour.memory is not None:
            colour = self._memories.read(message.colour)
        if message.depth is not None and message.depth.memory is not None:
            depth = self._memories.read(message.depth)
        return [colour, depth]

    def _handover(self) -> Handover[HandedFrame]:
        return Handover(
            newest_only=True, on_replaced=lambda frame: self.leave_out(frame.number, _NEWER)
        )
