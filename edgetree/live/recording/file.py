"""One recording: a folder with a ROS 2 bag (MCAP), and what it says about the run."""

from __future__ import annotations

import hashlib
import itertools
import time
from contextlib import suppress
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from basetree.errors import InputError
from basetree.files.regular import open_regular
from calib import PinholeCamera, RigidTransform
from edgetree.frames.rig import Rig
from edgetree.live.recording.messages import RecordedMessage, RecordingMessages
from edgetree.live.results import LiveResult
from edgetree.measure import MeasureSettings
from edgetree.sinks.bag import BagFolder, FolderTaken
from edgetree.sinks.ros_types import time_ns

RECORDING_SCHEMA: Final = "edgetree.recording/1"
_NS_PER_MESSAGE: Final = 1  # keeps the messages of a frame in order


class RecordingFile:
    """Writes frames into a folder that has its name when it is complete.

    Until then, and if the process is killed, it is called `unfinished_NAME`.

    Args:
        folder: The recording, a new folder.
        messages: Makes the messages.

    Raises:
        InputError: The folder cannot be made.
    """

    def __init__(self, folder: Path, messages: RecordingMessages) -> None:
        self.folder = folder
        self.frames = 0
        self._messages = messages
        self._bag = BagFolder(folder, messages.store, compressed=True, syncs=True)
        self._log_ns = 0

    def add(self, result: LiveResult) -> None:
        """Write a frame and its result.

        Raises:
            InputError: It cannot be written.
        """
        self._log_ns = max(time_ns(result.frame.stamp_s), self._log_ns)
        for message in self._messages.of_result(result):
            self._write(message)
        self.frames += 1

    def close(self, record: dict[str, Any]) -> None:
        """Complete the recording.

        Args:
            record: What it says about the run.

        Raises:
            InputError: It cannot be written; then there is none.
        """
        try:
            self._write(self._messages.text("/edgetree/recording", record))
            self._bag.close()
        except InputError:
            self.discard()
            raise

    def discard(self) -> None:
        """Remove what was written."""
        self._bag.discard()

    def _write(self, message: RecordedMessage) -> None:
        self._bag.write(message.topic, message.kind, self._log_ns, message.message)
        self._log_ns += _NS_PER_MESSAGE


def new_recording(parent: Path, kind: str, messages: RecordingMessages) -> RecordingFile:
    """Begin a recording, such as `mark_20261123_101530_1`, in local time, under a new name.

    Args:
        parent: Where to.
        kind: The first word of its name.
        messages: Makes the messages.

    Raises:
        InputError: The folder cannot be made.
    """
    stem = f"{kind}_{time.strftime('%Y%m%d_%H%M%S')}"
    for number in itertools.count(1):
        with suppress(FolderTaken):  # also by another process, in the same second
            return RecordingFile(parent / f"{stem}_{number}", messages)
    raise AssertionError("there are names enough")


def run_record(
    model: Path,
    *,
    source: str,
    score_threshold: float,
    rig: Rig,
    settings: MeasureSettings | None = None,
) -> dict[str, Any]:
    """What is needed beside the frames to reproduce a result, as a JSON object.

    Args:
        model: The model file.
        source: What the frames come from.
        score_threshold: Lowest score of trees.
        rig: The cameras.
        settings: Settings of the measurement; the defaults if None.

    Raises:
        OSError: The model file cannot be read.
    """
    with open_regular(model) as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return {
        "schema": RECORDING_SCHEMA,
        "edgetree": version("edgetree"),
        "source": source,
        "model": {"file": model.name, "sha256": digest},
        "score_threshold": score_threshold,
        "rig": {
            "camera": None if rig.camera is None else _camera(rig.camera),
            "up_camera": rig.up_camera,
            "mounting": None if rig.mounting is None else _transform(rig.mounting),
            "uncertainty": asdict(rig.known_uncertainty()),
        },
        "measure": asdict(settings or MeasureSettings()),
    }


def _camera(camera: PinholeCamera) -> dict[str, Any]:
    """The camera; null for the size where its file does not state one."""
    if camera.has_size:
        return camera.to_dict()
    return asdict(camera) | {"width": None, "height": None}


def _transform(transform: RigidTransform) -> dict[str, Any]:
    return {
        "rotation": transform.rotation.tolist(),
        "translation_m": transform.translation_m.tolist(),
    }
