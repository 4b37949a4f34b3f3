"""ROS 2 bags (MCAP), which appear when they are complete. Need the extra `record`."""

from __future__ import annotations

import sys
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from basetree.errors import InputError, MissingPackage, install_hint
from basetree.files.writing import replacing_folder
from edgetree.sinks.ros_messages import TOPICS, RosMessages
from edgetree.sinks.ros_types import time_ns
from edgetree.sinks.sink import FileSink

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult

_VERSION: Final = 9


class BagSink(FileSink["LiveResult"]):
    """Writes pictures, cameras, poses and stems as a ROS 2 bag, which Foxglove and Rerun open.

    Args:
        folder: The bag, a new folder, which appears when the sink is closed. It holds
            `FOLDER.mcap` and `metadata.yaml`.

    Raises:
        InputError: The folder exists already or cannot be made.
        MissingPackage: Rosbags is not installed.
    """

    def __init__(self, folder: Path) -> None:
        check_rosbags()
        super().__init__()
        self._messages = RosMessages()
        self._bag = BagFolder(folder, self._messages.store)
        self._files.callback(self._bag.close)

    def write(self, result: LiveResult) -> None:
        """Write the messages of one result."""
        log_ns = time_ns(result.frame.stamp_s)
        for topic, message in self._messages.all(result):
            self._bag.write(topic, TOPICS[topic], log_ns, message)


class BagFolder:
    """A bag that is written beside its path.

    Args:
        folder: The bag, a new folder. It holds `FOLDER.mcap` and `metadata.yaml`.
        types: The type store of rosbags.
        compressed: Whether the messages are compressed, without loss (zstd).

    Raises:
        InputError: The folder exists already or cannot be made.
        MissingPackage: Rosbags is not installed.
    """

    def __init__(self, folder: Path, types: Any, *, compressed: bool = False) -> None:
        check_rosbags()
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        if folder.exists():
            raise InputError(f"{folder} exists already: expected the name of a new folder")
        self.folder = folder
        self._types = types
        self._connections: dict[str, Any] = {}
        self._files = ExitStack()
        try:
            self._parts = self._files.enter_context(replacing_folder(folder))
            made = self._parts / folder.name
            self._writer = Writer(made, version=_VERSION, storage_plugin=StoragePlugin.MCAP)
            if compressed:
                self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
        except OSError as error:
            self._files.__exit__(*sys.exc_info())
            raise self._unwritable(error) from error

    def write(self, topic: str, kind: str, log_ns: int, message: Any) -> None:
        """Write a message.

        Args:
            topic: Its topic, which is made with the first message.
            kind: Its type, such as "std_msgs/msg/String".
            log_ns: Its time in the bag, ns.
            message: The message.

        Raises:
            InputError: The bag cannot be written.
        """
        try:
            if topic not in self._connections:
                self._connections[topic] = self._writer.add_connection(
                    topic, kind, typestore=self._types
                )
            data = self._types.serialize_cdr(message, kind)
            self._writer.write(self._connections[topic], log_ns, data)
        except OSError as error:
            raise self._unwritable(error) from error

    def close(self) -> None:
        """Complete the bag.

        Raises:
            InputError: The bag cannot be written; then there is none.
        """
        try:
            self._writer.close()
            made = self._parts / self.folder.name
            for file in list(made.iterdir()):
                file.rename(self._parts / file.name)
            made.rmdir()
            self._files.close()
        except OSError as error:
            self.discard()
            raise self._unwritable(error) from error

    def discard(self) -> None:
        """Remove what was written."""
        with suppress(OSError):  # of what is still to be written
            self._writer.abort()
        self._files.__exit__(InputError, InputError(f"{self.folder} is not wanted"), None)

    def _unwritable(self, error: OSError) -> InputError:
        return InputError(
            f"{self.folder} cannot be written ({error.strerror}):"
            " expected a new folder in an existing, writable one with space for it"
        )


def check_rosbags() -> None:
    """Check that bags can be written.

    Raises:
        MissingPackage: Rosbags is not installed.
    """
    try:
        import rosbags.rosbag2  # noqa: F401
    except ImportError as error:
        raise MissingPackage(
            f"a bag needs the package rosbags: {install_hint('record')}"
        ) from error
