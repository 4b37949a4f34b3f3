"""What all kinds of recordings have in common: channels, and their messages by time."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol


@dataclass(eq=False)
class Channel:
    """Messages of one type on one topic.

    Attributes:
        topic: The topic's name.
        message_type: Type of the messages, such as "sensor_msgs/msg/Image", also for ROS 1.
        encoding: How they are encoded: "cdr" (ROS 2), "ros1", "json", "protobuf" or another.
        count: Number of messages.
        schema: Definition of the type, for "protobuf".
    """

    topic: str
    message_type: str
    encoding: str
    count: int = 0
    schema: bytes = b""


class Stored(NamedTuple):
    """A message as it is stored.

    Attributes:
        channel: Its channel.
        log_ns: When it was recorded, ns.
        data: Its bytes.
    """

    channel: Channel
    log_ns: int
    data: bytes


class Storage(Protocol):
    """An open file of a recording.

    Attributes:
        channels: Its channels.
        is_cut_off: Whether its end is missing, and what is there is read.
        start_ns: Time of the first message, ns.
        end_ns: Time of the last message, ns.
    """

    channels: list[Channel]
    is_cut_off: bool
    start_ns: int
    end_ns: int

    def messages(self, channels: Collection[Channel]) -> Iterator[Stored]:
        """Yield the messages of channels in the order of time."""
        ...

    def close(self) -> None:
        """Close the file."""
        ...


def normal_type(name: str) -> str:
    """The name of a type of ROS 1 as ROS 2 writes it: sensor_msgs/msg/Image."""
    package, _, kind = name.partition("/")
    return f"{package}/msg/{kind}" if kind and "/" not in kind else name
