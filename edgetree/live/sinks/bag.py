"""A ROS 2 bag (MCAP) of standard messages. Needs the extra `record`."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

from calib.writing import replacing_folder
from edgetree.errors import InputError, MissingDependency, install_hint
from edgetree.live.results import LiveResult
from edgetree.live.sinks.ros_messages import TOPICS, RosMessages

__all__ = ["BagSink"]

_VERSION: Final = 9


class BagSink:
    """Writes pictures, cameras, poses and stems as a ROS 2 bag, which Foxglove and Rerun open.

    Args:
        folder: the bag, a new folder, which appears when the sink is closed. It holds
            `FOLDER.mcap` and `metadata.yaml`.

    Raises:
        InputError: the folder exists already or cannot be made.
        MissingDependency: rosbags is not installed.
    """

    def __init__(self, folder: Path) -> None:
        writer, storage = _rosbags()
        if folder.exists():
            raise InputError(f"{folder} exists already: expected the name of a new folder")
        self._folder = folder
        self._files = ExitStack()
        try:
            self._parts = self._files.enter_context(replacing_folder(folder))
            self._writer = writer(
                self._parts / folder.name, version=_VERSION, storage_plugin=storage.MCAP
            )
            self._writer.open()
        except OSError as error:
            self._files.close()
            raise self._unwritable(error) from error
        self._messages = RosMessages()
        self._connections: dict[str, Any] = {
            topic: self._writer.add_connection(topic, kind, typestore=self._messages.types)
            for topic, kind in TOPICS.items()
        }
        self._is_open = True

    def write(self, result: LiveResult) -> None:
        """Write the messages of one result."""
        time_ns = max(round(result.frame.time_s * 1e9), 0)
        try:
            for topic, message in self._messages.all(result):
                data = self._messages.types.serialize_cdr(message, TOPICS[topic])
                self._writer.write(self._connections[topic], time_ns, data)
        except OSError as error:
            raise self._unwritable(error) from error

    def close(self) -> None:
        """Complete the bag."""
        if not self._is_open:
            return
        self._is_open = False
        with self._files:
            try:
                self._writer.close()
                made = self._parts / self._folder.name
                for file in list(made.iterdir()):
                    file.rename(self._parts / file.name)
                made.rmdir()
            except OSError as error:
                raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> InputError:
        return InputError(
            f"{self._folder} cannot be written ({error.strerror}):"
            " expected a new folder in an existing, writable one with space for it"
        )


def _rosbags() -> tuple[Any, Any]:
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
    except ImportError as error:
        raise MissingDependency(
            f"a bag needs the package rosbags: {install_hint('record')}"
        ) from error
    return Writer, StoragePlugin
