"""Read the messages of ROS 1 bags, ROS 2 bags and MCAP files, with the package rosbags.

Messages are decoded with the definitions of the ROS distributions. Those inside of the recording
are not read: bags of older ROS 2 have none, and the types that are needed here never changed.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

from basetree.errors import EdgetreeError, InputError, MissingPackage, install_hint, short_line
from edgetree.sources.bags.cut_off import readable_file
from edgetree.sources.bags.names import BAG_SUFFIXES, storage_files
from edgetree.sources.bags.video_packets import DEFINITIONS

TF_TYPE: Final = "tf2_msgs/msg/TFMessage"
_OLD_TF_TYPE: Final = "tf/msg/tfMessage"  # of ROS 1 before 2013, with the same content


class BrokenRecording(InputError):
    """A recording that cannot be read, or not any further."""


@dataclass
class Topic:
    """A topic of a recording.

    Attributes:
        name: Its name, such as "/camera/color/image_raw".
        message_type: Its type, such as "sensor_msgs/msg/Image", also for ROS 1.
        count: Number of its messages.
        connections: What rosbags knows it by.
    """

    name: str
    message_type: str
    count: int = 0
    connections: list[Any] = field(default_factory=list)


class Message(NamedTuple):
    """A message, not decoded.

    Attributes:
        topic: Its topic.
        log_ns: When it was recorded, ns.
        data: Its bytes.
    """

    topic: Topic
    log_ns: int
    data: bytes


class Bag:
    """An open recording.

    Args:
        path: a ROS 1 bag (.bag), an MCAP file, a database of a ROS 2 bag (.db3), or the folder of a
            ROS 2 bag. Without its metadata.yaml, as after a power failure, the files are read.

    Attributes:
        topics: The topics by name.
        is_cut_off: Whether the end of the file is missing, and what is there is read.
        duration_ns: Time from the first to the last message, ns.

    Raises:
        InputError: It does not exist or cannot be read.
        MissingPackage: Rosbags is not installed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stack = ExitStack()
        with _named_errors(path):
            try:
                readers = _readers(path)
                for reader in readers:
                    reader.open()
                    self._stack.callback(_close, reader)
                self._is_ros1 = path.suffix.lower() == ".bag"
                self._types = _typestore(is_ros1=self._is_ros1)
                self.topics = _topics(readers)
                end_ns = max(reader.end_time for reader in readers)
                self.duration_ns = max(0, end_ns - min(reader.start_time for reader in readers))
            except BaseException:
                self._stack.close()
                raise
        self._readers = readers
        self.is_cut_off = any(not isinstance(reader.path, Path) for reader in readers)

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Yield the messages of topics in the order of recording.

        Raises:
            BrokenRecording: The recording cannot be read any further.
        """
        topics = {id(c): self.topics[name] for name in names for c in self.topics[name].connections}
        parts = []
        for reader in self._readers:
            wanted = [c for c in reader.connections if id(c) in topics]
            if not wanted:
                continue
            # Without its index, an MCAP file is read in its own order, nearly that of time.
            is_scanned = not (isinstance(reader.path, Path) or self._is_ros1)
            read = reader.storage.messages_scan if is_scanned else reader.messages
            parts.append(read(wanted))
        with _named_errors(self.path):
            for connection, log_ns, data in heapq.merge(*parts, key=lambda entry: entry[1]):
                yield Message(topics[id(connection)], log_ns, data)

    def first(self, name: str) -> Any | None:
        """The first message of a topic, decoded; None if it has none that can be decoded."""
        message = next(self.messages([name]), None) if self.topics[name].count else None
        return None if message is None else self.decode(message)

    def decode(self, message: Message) -> Any | None:
        """Decode a message; None if its bytes do not fit its type."""
        kind = message.topic.message_type
        kind = TF_TYPE if kind == _OLD_TF_TYPE else kind
        decode = self._types.deserialize_ros1 if self._is_ros1 else self._types.deserialize_cdr
        with suppress(Exception):  # rosbags has no error of its own for most kinds of broken bytes
            return decode(message.data, kind)
        return None


def _readers(path: Path) -> list[Any]:
    """The readers of the files of a recording, not opened."""
    if not path.exists():
        raise InputError(
            f"recording {path} does not exist: expected a file ({', '.join(BAG_SUFFIXES)}) or the"
            " folder of a ROS 2 bag"
        )
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise MissingPackage(
            f"rosbags is not installed, which recordings need: {install_hint('record')}"
        ) from error
    if not path.is_dir():
        if path.stat().st_size == 0:
            raise InputError(f"recording {path} is empty: expected messages")
        if path.suffix.lower() == ".bag":
            return [rosbag1.Reader(readable_file(path))]
        return [rosbag2.Reader(readable_file(path))]
    if (path / "metadata.yaml").is_file():
        return [rosbag2.Reader(path)]
    files = [file for file in storage_files(path) if file.stat().st_size]
    if not files:
        raise InputError(
            f"recording {path} has no metadata.yaml: expected the folder of a ROS 2 bag"
        )
    return [rosbag2.Reader(readable_file(file)) for file in files]


@cache
def _typestore(*, is_ros1: bool) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    latest = get_typestore(Stores.LATEST)
    for name, text in DEFINITIONS.items():
        latest.register(get_types_from_msg(text, name))
    if not is_ros1:
        return latest
    store = get_typestore(Stores.ROS1_NOETIC)
    if TF_TYPE not in store.fielddefs:
        store.register({TF_TYPE: latest.fielddefs[TF_TYPE]})
    return store


def _topics(readers: list[Any]) -> dict[str, Topic]:
    topics: dict[str, Topic] = {}
    for reader in readers:
        for connection in reader.connections:
            topic = topics.setdefault(connection.topic, Topic(connection.topic, connection.msgtype))
            if topic.message_type == connection.msgtype:
                topic.count += connection.msgcount
                topic.connections.append(connection)
    return topics


def _close(reader: Any) -> None:
    with suppress(Exception):  # a file that broke while it was read may fail to close as well
        reader.close()


@contextmanager
def _named_errors(path: Path) -> Iterator[None]:
    """Turn what rosbags raises for broken files, which are errors of many kinds, into one line."""
    try:
        yield
    except EdgetreeError:
        raise
    except Exception as error:
        reason = short_line(str(error) or type(error).__name__).rstrip(".")
        raise BrokenRecording(
            f"recording {path} cannot be read ({reason}): expected a complete ROS 1 bag, ROS 2 bag"
            f" or MCAP file of ROS 2"
        ) from error
