"""ROS 2 bags (MCAP), which have their name when they are complete. Need the extra `record`."""

from __future__ import annotations

import errno
import os
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from basetree.errors import InputError, MissingPackage, install_hint
from basetree.files.growing import GrowingFolder
from basetree.files.writing import UnwritableFile
from edgetree.sinks.ros_messages import TOPICS, RosMessages
from edgetree.sinks.ros_types import time_ns
from edgetree.sinks.sink import FileSink

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult

_VERSION: Final = 9
_CHUNK_S: Final = 1.0  # longest time that messages stay in memory


class FolderTaken(InputError):
    """A folder that was to be made exists already."""


class BagSink(FileSink["LiveResult"]):
    """Writes pictures, cameras, poses and stems as a ROS 2 bag, which Foxglove and Rerun open.

    Args:
        folder: The bag, a new folder with `FOLDER.mcap` and `metadata.yaml`. Until the sink is
            closed, and if the process is killed, it is called `unfinished_FOLDER`.

    Raises:
        InputError: The folder exists already or cannot be made.
        MissingPackage: Rosbags is not installed.
    """

    appears_whole = False

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
    """A bag that is written beside its path, in `unfinished_FOLDER`, which is readable as it is.

    If the process is killed, it holds all messages but those of the last second.

    Args:
        folder: The bag, a new folder. It holds `FOLDER.mcap` and `metadata.yaml`.
        types: The type store of rosbags.
        compressed: Whether the messages are compressed, without loss (zstd).
        syncs: Whether `write` waits for the disk now and then, for threads that may wait.

    Raises:
        InputError: The folder exists already or cannot be made.
        MissingPackage: Rosbags is not installed.
    """

    def __init__(
        self, folder: Path, types: Any, *, compressed: bool = False, syncs: bool = False
    ) -> None:
        check_rosbags()
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        self.folder = folder
        self._types, self._syncs = types, syncs
        self._connections: dict[str, Any] = {}
        self._parts = _new_folder(folder)
        made = self._parts.unfinished / folder.name
        try:
            self._writer = Writer(made, version=_VERSION, storage_plugin=StoragePlugin.MCAP)
            if compressed:
                self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
            _move_up(made)  # so that the folder is a bag, complete or not
        except OSError as error:
            self._parts.discard()
            raise _unwritable(folder, error) from error
        self._chunk_s = time.monotonic()

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
            if time.monotonic() - self._chunk_s > _CHUNK_S:
                self.flush()
        except OSError as error:
            raise _unwritable(self.folder, error) from error

    def flush(self) -> None:
        """Hand the messages so far to the system."""
        self._chunk_s = time.monotonic()
        storage: Any = self._writer.storage
        if storage.chunk.bio.tell():
            storage.close_chunk()
        storage.bio.flush()
        if self._syncs:
            os.fsync(storage.bio.fileno())

    def close(self) -> None:
        """Complete the bag.

        Raises:
            InputError: It cannot be written; what there is of it stays in `unfinished_FOLDER`.
        """
        try:
            self._writer.close()
            made = self._parts.unfinished / self.folder.name
            _move_up(made)
            made.rmdir()
            self._parts.complete()
        except OSError as error:
            with suppress(OSError):
                self._writer.abort()
            raise _unwritable(self.folder, error) from error

    def discard(self) -> None:
        """Remove what was written."""
        with suppress(OSError):  # of what is still to be written
            self._writer.abort()
        self._parts.discard()


def _new_folder(folder: Path) -> GrowingFolder:
    try:
        return GrowingFolder(folder)
    except UnwritableFile as error:
        if error.errno == errno.EEXIST:
            raise FolderTaken(
                f"{folder} or unfinished_{folder.name} exists already: expected the name of a new"
                " folder"
            ) from error
        raise _unwritable(folder, error) from error


def _unwritable(folder: Path, error: OSError) -> UnwritableFile:
    unwritable = UnwritableFile(
        f"{folder} cannot be written ({error.strerror}):"
        " expected a new folder in an existing, writable one with space for it"
    )
    unwritable.errno, unwritable.strerror = error.errno, error.strerror
    unwritable.filename = str(folder)
    return unwritable


def _move_up(made: Path) -> None:
    """Move the files of a folder into its parent; open ones stay where the system demands it."""
    for file in list(made.iterdir()):
        with suppress(PermissionError):
            file.rename(made.parent / file.name)


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
