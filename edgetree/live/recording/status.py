"""What a recorder tells about itself."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["RecorderStatus"]


@dataclass(frozen=True)
class RecorderStatus:
    """The state of a recorder.

    Attributes:
        written: recordings that are complete.
        failed: recordings that could not be written.
        left_out: frames that are missing in recordings, as the disk was too slow.
        is_recording: whether a recording is in progress.
    """

    written: int = 0
    failed: int = 0
    left_out: int = 0
    is_recording: bool = False

    def line(self) -> str:
        """The state as a part of a line of text."""
        parts = [f"{self.written} recording(s)"]
        if self.failed:
            parts.append(f"{self.failed} recording(s) failed")
        if self.left_out:
            parts.append(f"{self.left_out} frame(s) missing in recordings")
        return ", ".join(parts)
