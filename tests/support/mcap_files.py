"""Write MCAP files with messages of any encoding, by the package mcap."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
from bag_files import BagFile
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import CompressionType, Writer

_TIMESTAMP = ".google.protobuf.Timestamp"
_KINDS = {"bytes": 12, "string": 9, "uint32": 13, "double": 1}
_SCHEMAS = {
    "CompressedImage": [("frame_id", "string"), ("data", "bytes"), ("format", "string")],
    "RawImage": [
        ("frame_id", "string"),
        ("width", "uint32"),
        ("height", "uint32"),
        ("encoding", "string"),
        ("step", "uint32"),
        ("data", "bytes"),
    ],
    "CameraCalibration": [
        ("frame_id", "string"),
        ("width", "uint32"),
        ("height", "uint32"),
        ("distortion_model", "string"),
        ("D", "doubles"),
        ("K", "doubles"),
        ("R", "doubles"),
        ("P", "doubles"),
    ],
}


class McapOf:
    """Writes messages that are encoded already."""

    def __init__(self, path: Path, profile: str = "", **settings: Any) -> None:
        self.path = path
        self._file = path.open("wb")
        settings.setdefault("compression", CompressionType.ZSTD)
        self.writer = Writer(self._file, **settings)
        self.writer.start(profile=profile)
        self._channels: dict[str, int] = {}

    def __enter__(self) -> McapOf:
        return self

    def __exit__(self, *_: object) -> None:
        self.writer.finish()
        self._file.close()

    def add(
        self, topic: str, schema: tuple[str, str, bytes], encoding: str, data: bytes, ns: int
    ) -> None:
        """Write a message; a schema is its name, encoding and definition."""
        if topic not in self._channels:
            number = self.writer.register_schema(*schema)
            self._channels[topic] = self.writer.register_channel(topic, encoding, number)
        self.writer.add_message(self._channels[topic], ns, data, ns)


class Ros1InMcap(BagFile):
    """Writes messages of ROS 1 to an MCAP file, as a conversion of a bag does."""

    def __init__(self, path: Path, **settings: Any) -> None:
        super().__init__(path.parent, "ros1", "unused")
        self.mcap = McapOf(path, "ros1", **settings)

    def __enter__(self) -> Ros1InMcap:
        return self

    def __exit__(self, *_: object) -> None:
        self.mcap.__exit__()

    def write(self, topic: str, kind: str, message: Any, log_ns: int) -> None:
        name = kind.replace("/msg/", "/")
        data = bytes(self.store.serialize_ros1(message, kind))
        self.mcap.add(topic, (name, "ros1msg", b""), "ros1", data, log_ns)


def foxglove_json(mcap: McapOf, topic: str, name: str, stamp: int, **fields: Any) -> None:
    """Write a message of Foxglove as JSON; bytes become base64."""
    values: dict[str, Any] = {"timestamp": {"sec": stamp // 10**9, "nsec": stamp % 10**9}}
    for key, value in fields.items():
        values[key] = base64.b64encode(value).decode() if isinstance(value, bytes) else value
    data = json.dumps(values, default=np.ndarray.tolist).encode()
    mcap.add(topic, (f"foxglove.{name}", "jsonschema", b"{}"), "json", data, stamp)


def foxglove_protobuf(mcap: McapOf, topic: str, name: str, stamp: int, **fields: Any) -> None:
    """Write a message of Foxglove as protobuf."""
    files, kind = _protobuf_class(name)
    message = kind(**fields)
    message.timestamp.seconds, message.timestamp.nanos = stamp // 10**9, stamp % 10**9
    schema = (f"foxglove.{name}", "protobuf", files.SerializeToString())
    mcap.add(topic, schema, "protobuf", message.SerializeToString(), stamp)


def _protobuf_class(name: str) -> tuple[Any, Any]:
    time = descriptor_pb2.FileDescriptorProto(
        name="google/protobuf/timestamp.proto", package="google.protobuf", syntax="proto3"
    )
    entry = time.message_type.add(name="Timestamp")
    entry.field.add(name="seconds", number=1, type=3, label=1)
    entry.field.add(name="nanos", number=2, type=5, label=1)
    file = descriptor_pb2.FileDescriptorProto(
        name=f"foxglove/{name}.proto",
        package="foxglove",
        syntax="proto3",
        dependency=["google/protobuf/timestamp.proto"],
    )
    message = file.message_type.add(name=name)
    message.field.add(name="timestamp", number=1, type=11, label=1, type_name=_TIMESTAMP)
    for number, (field, kind) in enumerate(_SCHEMAS[name], 2):
        label = 3 if kind == "doubles" else 1
        message.field.add(name=field, number=number, type=_KINDS.get(kind, 1), label=label)
    pool = descriptor_pool.DescriptorPool()
    for each in (time, file):
        pool.Add(each)
    files = descriptor_pb2.FileDescriptorSet(file=[time, file])
    return files, message_factory.GetMessageClass(pool.FindMessageTypeByName(f"foxglove.{name}"))
