"""One recording: a folder with a ROS 2 bag (MCAP), which appears when it is complete."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Final

from basetree.errors import InputError
from edgetree.live.recording.messages import RecordedMessage, RecordingMessages
from edgetree.live.results import LiveResult
from edgetree.live.sinks.bag_folder import BagFolder
from edgetree.live.sinks.ros_types import time_ns

__all__ = ["RecordingFile", "new_folder"]

_NS_PER_MESSAGE: Final = 1  # keeps the messages of a frame in order


class RecordingFile:
    """Writes frames.

    Args:
        folder: the recording, a new folder.
        messages: makes the messages.

    Raises:
        InputError: the folder cannot be made.
    """

    def __init__(self, folder: Path, messages: RecordingMessages) -> None:
        self.folder = folder
        self.frames = 0
        self._messages = messages
        self._bag = BagFolder(folder, messages.store, compressed=True)
        self._log_ns = 0

    def add(self, result: LiveResult) -> None:
        """Write a frame and its result.

        Raises:
            InputError: it cannot be written.
        """
        self._log_ns = max(time_ns(result.frame.time_s), self._log_ns)
        for message in self._messages.of_result(result):
            self._write(message)
        self.frames += 1

    def close(self, record: dict[str, Any]) -> None:
        """Complete the recording.

        Args:
            record: what it says about the run.

        Raises:
            InputError: it cannot be written; then there is none.
        """
        try:
            self._write(self._messages.text("/edgetree/recording", record))
        except InputError:
            self.discard()
            raise
        self._bag.close()

    def discard(self) -> None:
        """Remove what was written."""
        self._bag.discard()

    def _write(self, message: RecordedMessage) -> None:
        self._bag.write(message.topic, message.kind, self._log_ns, message.message)
        self._log_ns += _NS_PER_MESSAGE


def new_folder(parent: Path, kind: str) -> Path:
    """The name of a new recording, such as `mark_20261123_101530_1`, in local time."""
    stem = f"{kind}_{time.strftime('%Y%m%d_%H%M%S')}"
    number = 1
    while (folder := parent / f"{stem}_{number}").exists():
        number += 1
    return folder
