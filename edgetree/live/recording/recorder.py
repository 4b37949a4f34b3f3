"""Record the seconds around marks, or everything, in a thread of its own."""

from __future__ import annotations

import logging
import math
import shutil
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from basetree.counts import counted
from basetree.errors import EdgetreeError, InputError
from edgetree.live.recording.file import RecordingFile, new_recording
from edgetree.live.recording.messages import RecordingMessages
from edgetree.live.recording.queue import FrameQueue, Window
from edgetree.live.results import LiveResult
from edgetree.sinks.bag import check_rosbags

_log = logging.getLogger(__name__)

_LONGEST_S: Final = 60.0  # of one recording; what is longer goes on in the next one
_CLOSE_S: Final = 1.0
_RESERVE_BYTES: Final = 2**30  # of the disk, which other outputs need


@dataclass(frozen=True)
class RecorderStatus:
    """The state of a recorder.

    Attributes:
        written: Recordings that are complete.
        failed: Recordings that could not be written.
        left_out: Frames that are missing in recordings, as the disk was too slow.
        is_recording: Whether a recording is in progress.
    """

    written: int = 0
    failed: int = 0
    left_out: int = 0
    is_recording: bool = False

    def line(self) -> str:
        """The state as a part of a line of text."""
        parts = [f"{counted(self.written, 'recording')}"]
        if self.failed:
            parts.append(f"{counted(self.failed, 'recording')} failed")
        if self.left_out:
            parts.append(f"{counted(self.left_out, 'frame')} missing in recordings")
        return ", ".join(parts)


class FrameRecorder:
    """Keeps the frames of the last seconds, and writes those around each mark as a recording.

    A recording is a ROS 2 bag (MCAP) with the frames as they were measured and the results, which
    `open_live_source` reads back without loss. A thread writes it; if that fails, one line is
    logged and nothing is left. Of a process that is killed, `unfinished_mark_...` is left, which is
    read too. Marks during a recording extend it. It is a sink of live results.

    Args:
        folder: Where recordings are made, `mark_DATE_TIME_N` each; made if it does not exist.
        before_s: Time before a mark, s.
        after_s: Time after a mark, s.
        everything: Whether all frames are written, in recordings `all_DATE_TIME_N` of a minute.
        max_mib: Limit of the frames in memory, MiB. Fewer seconds are kept if they do not fit.
        waits: Whether `write` waits for a slow disk, as for a source that is no camera. Otherwise
            frames are left out.
        about: What each recording says about the run, see `run_record`.

    Raises:
        InputError: a time or the limit is out of range, or the folder is a file.
        MissingPackage: Rosbags is not installed.
    """

    def __init__(
        self,
        folder: Path | str,
        *,
        before_s: float = 5.0,
        after_s: float = 2.0,
        everything: bool = False,
        max_mib: int = 512,
        waits: bool = False,
        about: Mapping[str, Any] | None = None,
    ) -> None:
        for name, value_s in (("before_s", before_s), ("after_s", after_s)):
            if not 0 <= value_s <= _LONGEST_S:
                raise InputError(f"{name} is {value_s:g} s: expected 0 to {_LONGEST_S:g} s")
        if max_mib < 1:
            raise InputError(f"max_mib is {max_mib}: expected at least 1 MiB")
        folder = Path(folder)
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder} is a file: expected a folder for recordings")
        check_rosbags()
        self._folder, self._kind = folder, "all" if everything else "mark"
        self._about = dict(about or {})
        self._messages = RecordingMessages()
        self._queue = FrameQueue(
            before_s, after_s, everything=everything, max_mib=max_mib, waits=waits
        )
        self._written = self._failed = 0
        self._thread = threading.Thread(target=self._run, name="edgetree-record", daemon=True)
        self._thread.start()

    @property
    def status(self) -> RecorderStatus:
        """What was written so far."""
        queue = self._queue
        return RecorderStatus(self._written, self._failed, queue.left_out, queue.is_recording)

    def mark(self, text: str = "") -> float:
        """Record the seconds around now. Returns at once; any thread and signal handler may call.

        Args:
            text: What the recording says about the mark.

        Returns:
            How much time before the mark is kept, s.
        """
        return self._queue.mark(text)

    def write(self, result: LiveResult) -> None:
        """Keep a frame with its result. Its arrays must not be changed afterwards."""
        self._queue.put(result)

    def wait_for_disk(self, *, waits: bool) -> None:
        """Set whether `write` waits for a slow disk instead of leaving out frames."""
        self._queue.waits = waits

    def close(self) -> None:
        """Complete the recording in progress.

        If `write` does not wait for the disk, this takes about a second: frames that are not
        written by then are left out.
        """
        self._queue.end(math.inf if self._queue.waits else _CLOSE_S)
        self._thread.join()

    def _run(self) -> None:
        """The thread that writes."""
        while (window := self._queue.next_window()) is not None:
            try:
                self._write(window)
            except Exception as error:  # noqa: BLE001 the measurement goes on
                known = isinstance(error, EdgetreeError | OSError)
                _log.warning("a recording failed: %s", error if known else repr(error))
                self._failed += 1
                self._queue.give_up(_LONGEST_S)

    def _write(self, window: Window) -> None:
        """Write the frames of a window, in recordings of bounded length."""
        file: RecordingFile | None = None
        began_s = 0.0
        try:
            while (kept := self._queue.next_frame(window)) is not None:
                is_full = self._is_disk_full()
                if file is not None and (is_full or kept.at_s - began_s >= _LONGEST_S):
                    done, file = file, None
                    self._complete(done, window, kept.at_s)
                if is_full:
                    raise InputError(
                        f"{self._folder} has less than 1 GiB of free space: expected more, which"
                        " other outputs may need"
                    )
                if file is None:
                    file = new_recording(self._folder, self._kind, self._messages)
                    began_s = kept.at_s
                file.add(kept.result)
            if file is not None:
                done, file = file, None
                self._complete(done, window, math.inf)
        finally:
            if file is not None:
                file.discard()

    def _is_disk_full(self) -> bool:
        self._folder.mkdir(parents=True, exist_ok=True)
        return shutil.disk_usage(self._folder).free < _RESERVE_BYTES

    def _complete(self, file: RecordingFile, window: Window, end_s: float) -> None:
        """Complete a recording with what is known of the run and the marks before a time, s."""
        marks = self._queue.take_marks(window, end_s)
        counts = {"frames": file.frames, "left_out": self._queue.left_out}
        file.close({**self._about, **counts, "marks": marks})
        self._written += 1
        _log.info("recording %s: %s", file.folder, counted(file.frames, "frame"))
