"""Decode the messages of recordings: ROS 2, ROS 1, and Foxglove's in protobuf and JSON.

ROS messages are decoded with the definitions of the ROS distributions. Those inside of the
recording are not read: bags of older ROS 2 have none, and the types that are needed here never
changed.
"""

from __future__ import annotations

from functools import cache
from typing import Any, Final

from basetree.errors import MissingPackage, install_hint
from basetree.files.json import parse_json
from edgetree.sources.bags import foxglove
from edgetree.sources.bags.bounded import ZSTD_MAGIC, Budget
from edgetree.sources.bags.storage import Channel
from edgetree.sources.bags.video_packets import DEFINITIONS as VIDEO_DEFINITIONS

TF_TYPE: Final = "tf2_msgs/msg/TFMessage"
_OLD_TF_TYPE: Final = "tf/msg/tfMessage"  # of ROS 1 before 2013, with the same content


def known_type(channel: Channel) -> str:
    """The type of ROS that a channel's messages are decoded to; its own name if it is unknown."""
    return foxglove.ROS_TYPES.get(foxglove.schema_of(channel.message_type), channel.message_type)


class Decoder:
    """Decodes the messages of one pass through a recording.

    Args:
        file_bytes: Size of the recording, for the limit of what is unpacked.
    """

    def __init__(self, file_bytes: int) -> None:
        self._budget = Budget(file_bytes)
        self._protobuf: dict[Channel, Any] = {}

    def decode(self, channel: Channel, data: bytes) -> Any | None:
        """Decode a message; None if its bytes do not fit its type.

        Raises:
            MissingPackage: The package that decodes it is not installed.
        """
        try:
            if data[:4] == ZSTD_MAGIC:  # packed one by one, as rosbag2 can
                data = self._budget.unpacked(data, "zstd")
            message = self._message(channel, data)
            if foxglove.is_foxglove(channel.message_type):
                return foxglove.as_ros(foxglove.schema_of(channel.message_type), message)
            return message
        except MissingPackage:
            raise
        except Exception:  # noqa: BLE001 - the packages have no error of their own for broken bytes
            return None

    def _message(self, channel: Channel, data: bytes) -> Any:
        kind = TF_TYPE if channel.message_type == _OLD_TF_TYPE else channel.message_type
        if channel.encoding == "cdr":
            return typestore(is_ros1=False).deserialize_cdr(data, kind)
        if channel.encoding == "ros1":
            return _ros1_message(data, kind)
        if not foxglove.is_foxglove(channel.message_type):
            raise ValueError(f"{channel.message_type} is not read from {channel.encoding}")
        if channel.encoding == "json":
            return foxglove.Fields(parse_json(data.decode()))
        if channel.encoding == "protobuf":
            if channel not in self._protobuf:
                self._protobuf[channel] = _protobuf_decoder(channel)
            return self._protobuf[channel](data)
        raise ValueError(f"the encoding is {channel.encoding!r}")


def _ros1_message(data: bytes, kind: str) -> Any:
    """Decode a message. Bytes after its end are allowed: RealSense's SDK adds some to images."""
    store = typestore(is_ros1=True)
    definition = store.get_msgdef(kind)
    message, _ = definition.deserialize_ros1(data, 0, definition.cls, store)
    return message


def _protobuf_decoder(channel: Channel) -> Any:
    try:
        from mcap.records import Schema
        from mcap_protobuf.decoder import DecoderFactory
    except ImportError as error:
        raise MissingPackage(
            f"topic {channel.topic} is encoded by protobuf, which needs the package"
            f" mcap-protobuf-support: {install_hint('record')}"
        ) from error
    schema = Schema(id=1, name=channel.message_type, encoding="protobuf", data=channel.schema)
    return DecoderFactory().decoder_for("protobuf", schema)


@cache
def typestore(*, is_ros1: bool) -> Any:
    """The types of ROS 1 or ROS 2 that are known."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    latest = get_typestore(Stores.LATEST)
    store = get_typestore(Stores.ROS1_NOETIC) if is_ros1 else latest
    if is_ros1 and TF_TYPE not in store.fielddefs:
        store.register({TF_TYPE: latest.fielddefs[TF_TYPE]})
    texts = {f"foxglove_msgs/msg/{name}": text for name, text in foxglove.DEFINITIONS.items()}
    for name, text in (texts | VIDEO_DEFINITIONS).items():
        if name not in store.fielddefs:
            store.register(get_types_from_msg(text, name))
    return store
