"""An open recording: its topics, and their messages by time."""

from __future__ import annotations

import heapq
import logging
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, Final, NamedTuple

from basetree.errors import EdgetreeError, InputError, MissingPackage, install_hint, short_line
from edgetree.sources.bags import realsense_sdk
from edgetree.sources.bags.decoding import TF_TYPE, Decoder, known_type
from edgetree.sources.bags.opening import (
    empty_files,
    missing_files,
    open_storage,
    recording_files,
)
from edgetree.sources.bags.storage import Channel, Storage

__all__ = ["TF_TYPE", "Bag", "BrokenRecording", "Message", "Topic"]

_log = logging.getLogger(__name__)

_FIRST: Final = 10  # messages that are tried, if the first of a topic is broken


class BrokenRecording(InputError):
    """A recording that cannot be read, or not any further."""


@dataclass
class Topic:
    """A topic of a recording.

    Attributes:
        name: Its name, such as "/camera/color/image_raw".
        message_type: Its type, such as "sensor_msgs/msg/Image", also for ROS 1, and for messages of
            Foxglove with this content.
        count: Number of its messages.
        channels: Its channels in the files.
    """

    name: str
    message_type: str
    count: int = 0
    channels: list[Channel] = field(default_factory=list)


class Message(NamedTuple):
    """A message, not decoded.

    Attributes:
        topic: Its topic.
        log_ns: When it was recorded, ns.
        data: Its bytes.
        channel: Its channel in the file.
    """

    topic: Topic
    log_ns: int
    data: bytes
    channel: Channel


class Bag:
    """An open recording.

    Args:
        path: a ROS 1 bag (.bag, .bag.active), an MCAP file, a database of a ROS 2 bag (.db3), one
            of these packed as a whole (.zstd), or a folder of them, which are one recording in
            the order of time.

    Attributes:
        topics: The topics by name.
        is_cut_off: Whether the end of a file is missing, and what is there is read.
        missing: Names of files that belong to the recording and are not there.
        empty: Names of its files that hold nothing.
        duration_ns: Time from the first to the last message, ns.

    Raises:
        InputError: It does not exist or cannot be read.
        MissingPackage: Rosbags is not installed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        files = recording_files(path)
        check_packages()
        self.missing, self.empty = missing_files(path), empty_files(path)
        self._stack = ExitStack()
        self._files: list[Storage] = []
        with _named_errors(path):
            try:
                for file in files:
                    self._files.append(open_storage(file))
                    self._stack.callback(_close, self._files[-1])
                self.topics = _topics(self._files)
                end_ns = max(file.end_ns for file in self._files)
                self.duration_ns = max(0, end_ns - min(file.start_ns for file in self._files))
            except BaseException:
                self._stack.close()
                raise
        self._decoder = Decoder(sum(file.stat().st_size for file in files))
        self.is_cut_off = any(file.is_cut_off for file in self._files)

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def depth_unit_m(self) -> float | None:
        """Metres per step of the depth, as far as the recording says; None if it does not."""
        topic = realsense_sdk.depth_unit_topic(self.topics)
        message = None if topic is None else self.first(topic)
        return None if message is None else realsense_sdk.depth_unit_m(message)

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Yield the messages of topics in the order of recording.

        Raises:
            BrokenRecording: The recording cannot be read any further.
        """
        topics = {
            channel: self.topics[name] for name in names for channel in self.topics[name].channels
        }
        parts = []
        for file in self._files:
            wanted = [channel for channel in file.channels if channel in topics]
            if wanted:
                parts.append(file.messages(wanted))
        with _named_errors(self.path):
            for channel, log_ns, data in heapq.merge(*parts, key=lambda entry: entry.log_ns):
                yield Message(topics[channel], log_ns, data, channel)

    def first(self, name: str) -> Any | None:
        """The first message of a topic that can be decoded; None if none of the first ones can."""
        messages = self.messages([name]) if self.topics[name].count else iter(())
        contents = (self.decode(message) for message in islice(messages, _FIRST))
        return next((content for content in contents if content is not None), None)

    def decode(self, message: Message) -> Any | None:
        """Decode a message; None if its bytes do not fit its type.

        Raises:
            MissingPackage: The package that decodes it is not installed.
        """
        content = self._decoder.decode(message.channel, message.data)
        if content is None:
            return None
        with suppress(AttributeError, ValueError, InputError):
            return realsense_sdk.completed(message.topic.name, content, self.topics)
        return None


def check_packages() -> None:
    """Check that what recordings need is installed.

    Raises:
        MissingPackage: It is not.
    """
    for name in ("rosbags", "mcap"):
        try:
            __import__(name)
        except ImportError as error:
            raise MissingPackage(
                f"{name} is not installed, which recordings need: {install_hint('record')}"
            ) from error


def _topics(files: list[Storage]) -> dict[str, Topic]:
    topics: dict[str, Topic] = {}
    for file in files:
        for channel in file.channels:
            kind = realsense_sdk.type_of(channel.topic, known_type(channel))
            topic = topics.setdefault(channel.topic, Topic(channel.topic, kind))
            if topic.message_type == kind:
                topic.count += channel.count
                topic.channels.append(channel)
            else:
                _log.warning(
                    "topic %s is of %s and of %s: the second is left out",
                    channel.topic,
                    topic.message_type,
                    kind,
                )
    return topics


def _close(file: Storage) -> None:
    with suppress(Exception):  # a file that broke while it was read may fail to close as well
        file.close()


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
            " or MCAP file"
        ) from error
