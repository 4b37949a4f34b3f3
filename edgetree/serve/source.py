"""The frames that programs hand over, as a source of the live pipeline."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from basetree.errors import InputError
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.serve.handed import HandedFrame
from edgetree.sources.pushed import Handover
from edgetree.sources.source import BaseSource


class HandedFrames(BaseSource):
    """A live source of what other programs hand over. Only the newest frame is kept.

    Args:
        frames: Gives the frames.
        rig: Its camera takes the place of the frames' own; it corrects the depth.
        refused: Called with the number of a frame that cannot be used, and the reason.
    """

    is_live = True

    def __init__(
        self, frames: Handover[HandedFrame], rig: Rig, refused: Callable[[int, str], object]
    ) -> None:
        super().__init__("the program that hands frames over")
        self._frames = frames
        self._rig = rig
        self._refused = refused

    def __iter__(self) -> Iterator[Frame]:
        for handed in self.handed():
            try:
                frame = handed.frame(self._rig)
            except InputError as error:
                self.counts["frames that cannot be used"] += 1
                self._refused(handed.number, str(error))
                continue
            yield frame

    def handed(self) -> Iterator[HandedFrame]:
        """Yield the frames as they were handed over, in place of iterating over metres."""
        return iter(self._frames)

    def close(self) -> None:
        """End the iteration after the frame that waits."""
        self._frames.end()
