"""Frames that a program hands over itself, such as from the callbacks of a driver or of ROS."""

from __future__ import annotations

from collections.abc import Iterator

from edgetree.live.frames import LiveFrame
from edgetree.live.handover import Handover

__all__ = ["PushedFrames"]


class PushedFrames:
    """A live source whose frames another thread pushes. Only the newest frame is kept.

    Args:
        name: what messages call it.
    """

    is_live = True

    def __init__(self, name: str) -> None:
        self.name = name
        self._frames: Handover[LiveFrame] = Handover(newest_only=True)

    @property
    def counts(self) -> dict[str, int]:
        """Frames that were replaced before they were taken."""
        dropped = self._frames.dropped
        return {"replaced by a newer frame": dropped} if dropped else {}

    def push(self, frame: LiveFrame) -> bool:
        """Hand over a frame, from any thread; returns False if the source is closed."""
        return self._frames.put(frame)

    def __iter__(self) -> Iterator[LiveFrame]:
        return iter(self._frames)

    def close(self) -> None:
        """End the iteration after the frame that waits."""
        self._frames.end()
