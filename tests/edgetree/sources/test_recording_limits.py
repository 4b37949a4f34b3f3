"""Recordings that state or unpack to far more than they have."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from basetree.errors import InputError
from basetree.files.limits import current_limits, set_limits
from edgetree.sources.bags.recording import open_recording

pytest.importorskip("mcap")
zstandard = pytest.importorskip("zstandard")

MAGIC = b"\x89MCAP0\r\n"
BOMB = bytes(2**26)


@pytest.fixture(autouse=True)
def limits() -> Iterator[None]:
    """A chunk may have a megabyte."""
    before = set_limits(replace(current_limits(), recording_chunk_bytes=2**20))
    yield
    set_limits(before)


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def chunk(compression: str, data: bytes, size: int) -> bytes:
    head = struct.pack("<QQQI", 0, 1, size, 0)
    return record(6, head + text(compression) + struct.pack("<Q", len(data)) + data)


def channel() -> bytes:
    schema = struct.pack("<H", 1) + text("sensor_msgs/msg/Image") + text("ros2msg") + text("")
    fields = struct.pack("<HH", 1, 1) + text("/a") + text("cdr") + text("")
    return record(3, schema) + record(4, fields)


def mcap(*records: bytes) -> bytes:
    footer = record(2, struct.pack("<QQI", 0, 0, 0))
    return MAGIC + record(1, text("ros2") + text("")) + b"".join(records) + footer + MAGIC


def packed(compression: str) -> bytes:
    if compression == "zstd":
        return zstandard.ZstdCompressor().compress(BOMB)
    if compression == "zstd without a size":
        packer = zstandard.ZstdCompressor(write_content_size=False)
        return packer.compress(BOMB)
    import lz4.frame

    return lz4.frame.compress(BOMB)


@pytest.mark.parametrize("compression", ["zstd", "zstd without a size", "lz4"])
@pytest.mark.parametrize("stated", [2**40, len(BOMB), 1000])
def test_chunks_of_mcap_that_are_too_large(tmp_path: Path, compression: str, stated: int) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(mcap(chunk(compression.split()[0], packed(compression), stated)))
    with pytest.raises(InputError, match=r"cannot be read .*a chunk has"):
        open_recording(path)


def test_many_chunks_that_unpack_to_far_more_than_the_file_has(tmp_path: Path) -> None:
    small = zstandard.ZstdCompressor().compress(bytes(2**20))
    path = tmp_path / "a.mcap"
    path.write_bytes(mcap(*[chunk("zstd", small, 2**20)] * 20))
    with pytest.raises(InputError, match="unpacks to more than 1000 times its size"):
        open_recording(path)


@pytest.mark.parametrize("length", [2**63, 2**40, 1000])
@pytest.mark.parametrize("kind", [3, 4, 5, 6, 9])
def test_records_that_state_more_bytes_than_there_are(
    tmp_path: Path, kind: int, length: int
) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(mcap(struct.pack("<BQ", kind, length)))
    with pytest.raises(InputError, match="more than there are"):
        open_recording(path)


def test_chunk_indexes_of_one_chunk_read_it_once(bags: Any, tmp_path: Path) -> None:
    with bags.BagFile(tmp_path, "mcap") as bag:
        for number in range(3):
            bag.image(bags.COLOUR, bags.small_frame().image, bags.START_NS + number)
    data = bag.file.read_bytes()
    (start,) = struct.unpack_from("<Q", data, len(data) - 28)
    footer = len(data) - 37
    position, indexes = start, b""
    while position < footer:
        kind, length = struct.unpack_from("<BQ", data, position)
        if kind == 8:
            indexes += data[position : position + 9 + length]
        position += 9 + length
    assert indexes
    bag.file.write_bytes(data[:footer] + indexes * 50 + data[footer:])
    assert len(list(open_recording(bag.file))) == 3


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_chunks_of_a_ros_1_bag_that_are_too_large(
    bags: Any, tmp_path: Path, compression: str
) -> None:
    from rosbags.rosbag1 import Writer

    bag = bags.BagFile(tmp_path, "ros1")
    bag._writer.chunk_threshold = 2**25
    bag._writer.set_compression(Writer.CompressionFormat[compression])
    with bag:
        for number in range(400):
            bag.image(bags.COLOUR, bags.small_frame().image, bags.START_NS + number)
    assert bag.path.stat().st_size < 2**20
    with pytest.raises(InputError, match="a chunk has more than 1048576 bytes"):
        open_recording(bag.path)


def test_one_chunk_many_times_in_the_index_of_a_ros_1_bag(bags: Any, tmp_path: Path) -> None:
    with bags.BagFile(tmp_path, "ros1") as bag:
        bag.image(bags.COLOUR, bags.small_frame().image, bags.START_NS)
    data = bytearray(bag.path.read_bytes())
    (index,) = struct.unpack_from("<Q", data, data.find(b"index_pos=") + 10)
    records, position = [], index
    while position < len(data):
        (head,) = struct.unpack_from("<I", data, position)
        (size,) = struct.unpack_from("<I", data, position + 4 + head)
        records.append(bytes(data[position : position + 8 + head + size]))
        position += 8 + head + size
    count = data.find(b"chunk_count=") + 12
    data[count : count + 4] = struct.pack("<I", 51)
    bag.path.write_bytes(bytes(data) + records[-1] * 50)
    with pytest.raises(InputError, match="a chunk is twice in its index"):
        open_recording(bag.path)


def database(path: Path, messages: str, topics: str = "") -> Path:
    connection = sqlite3.connect(path)
    topics = topics or "CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format)"
    connection.executescript(f"{topics}; {messages}")
    connection.execute("INSERT INTO topics VALUES (1, '/a', 'sensor_msgs/msg/Image', 'cdr')")
    connection.commit()
    connection.close()
    return path


@pytest.mark.parametrize(
    ("messages", "told"),
    [
        (
            "CREATE TABLE messages(id, topic_id, timestamp, data AS (zeroblob(900000000)))",
            "its table messages has computed columns",
        ),
        (
            "CREATE TABLE real(id); CREATE VIEW messages AS SELECT id, 1 AS topic_id,"
            " 1 AS timestamp, zeroblob(900000000) AS data FROM real",
            "it has no table messages",
        ),
    ],
)
def test_databases_that_compute_their_content(tmp_path: Path, messages: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        open_recording(database(tmp_path / "a.db3", messages))


@pytest.mark.parametrize(
    ("column", "value"), [("name", b"/a"), ("type", b"x"), ("serialization_format", None)]
)
def test_texts_of_a_database_that_are_none(tmp_path: Path, column: str, value: object) -> None:
    path = database(tmp_path / "a.db3", "CREATE TABLE messages(id, topic_id, timestamp, data)")
    connection = sqlite3.connect(path)
    connection.execute(f"UPDATE topics SET {column} = ?", (value,))
    connection.commit()
    connection.close()
    with pytest.raises(InputError, match=f"a {column} in its table topics is no text"):
        open_recording(path)


def test_a_time_of_a_database_that_is_no_number_ends_it(write_bag: Any) -> None:
    path = write_bag("sqlite3", 5)
    file = next(path.glob("*.db3"))
    connection = sqlite3.connect(file)
    connection.execute("UPDATE messages SET timestamp = 'late' WHERE id = 1")
    connection.execute("UPDATE messages SET data = 'text' WHERE id = 2")
    connection.commit()
    connection.close()
    source = open_recording(file)
    assert len(list(source)) >= 3
    assert source.counts["ended early"] == 1


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("camera", [1]),
        ("camera", 5),
        ("camera", {"width": []}),
        ("up_camera", "up"),
        ("up_camera", [1]),
        ("depth_noise", {"noise_m": "much"}),
        ("depth_noise", {"noise_m": -1}),
        ("depth_noise", {"loudness": 1}),
        ("rotation_deg", 45),
        ("rotation_deg", "up"),
        ("stamp_ns", "5"),
        ("stamp_ns", 1.5),
        ("schema", 3),
    ],
)
def test_exact_values_of_another_kind_are_counted(
    bags: Any, tmp_path: Path, field: str, value: object
) -> None:
    import json

    from edgetree.sources.bags.exact import EXACT_TOPIC, exact_record

    with bags.BagFile(tmp_path, "mcap") as bag:
        frame = bags.small_frame()
        values = exact_record(bags.START_NS, frame.camera, None) | {field: value}
        kind = "std_msgs/msg/String"
        bag.write(EXACT_TOPIC, kind, bag.message(kind, data=json.dumps(values)), bags.START_NS)
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
    source = open_recording(bag.path)
    assert len(list(source)) == 1
    assert source.counts["unreadable messages"] == 1
