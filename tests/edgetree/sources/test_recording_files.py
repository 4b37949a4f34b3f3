"""Names, packings and leftovers of recordings: what lies on a machine after a drive or a crash."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from basetree.errors import InputError
from edgetree.sources.bags.names import is_bag
from edgetree.sources.bags.recording import open_recording

pytest.importorskip("mcap")
from mcap_files import Ros1InMcap

zstandard = pytest.importorskip("zstandard")

Writer = Callable[..., Path]


def storage(path: Path) -> Path:
    """The file with the messages."""
    if path.is_file():
        return path
    return next(file for file in path.iterdir() if file.suffix in (".mcap", ".db3"))


def packed(file: Path, name: str, folder: Path) -> Path:
    target = folder / name
    target.write_bytes(zstandard.ZstdCompressor().compress(file.read_bytes()))
    return target


@pytest.mark.parametrize(
    "name",
    ["a.bag", "a.bag.active", "a.BAG", "a.mcap", "a.mcap.zstd", "a.db3.zst", "a.mcap.active"],
)
def test_names_of_recordings(tmp_path: Path, name: str) -> None:
    assert is_bag(tmp_path / name)


@pytest.mark.parametrize("name", ["a.zstd", "a.active", "a.png", "bag", "a.bag.txt", "a.jpg.zstd"])
def test_names_of_other_files(tmp_path: Path, name: str) -> None:
    assert not is_bag(tmp_path / name)


@pytest.mark.parametrize("name", ["drive.bag.active", "drive.bag", "no_suffix.mcap"])
def test_the_first_bytes_decide_and_not_the_name(
    write_bag: Writer, tmp_path: Path, name: str
) -> None:
    file = write_bag("ros1")
    renamed = file.rename(tmp_path / name)
    assert len(list(open_recording(renamed))) == 5


def test_split_bags_are_one_recording_in_the_order_of_time(bags: Any, tmp_path: Path) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    for part in (10, 2, 1):  # 10 comes last, whatever the letters say
        with bags.BagFile(folder, "ros1", f"drive_{part}") as bag:
            for number in range(3):
                stamp = bags.START_NS + (part * 3 + number) * bags.PERIOD_NS
                bag.image(bags.COLOUR, bags.small_frame(part).image, stamp)
    assert is_bag(folder)
    frames = list(open_recording(folder))
    assert len(frames) == 9
    times = [frame.time_s for frame in frames]
    assert times == sorted(times)


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_a_file_that_metadata_lists_and_that_is_missing_is_told(
    bags: Any, write_bag: Writer, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = write_bag(kind)
    metadata = path / "metadata.yaml"
    name = storage(path).name
    listed = metadata.read_text().replace(name, "gone.mcap")
    metadata.write_text(listed)
    source = open_recording(path)
    assert len(list(source)) == 5
    assert source.counts["files missing"] == 1
    assert "its file gone.mcap is missing" in caplog.text


@pytest.mark.parametrize("kind", ["mcap", "sqlite3", "ros1"])
def test_a_packed_file_is_read_alone(write_bag: Writer, tmp_path: Path, kind: str) -> None:
    file = storage(write_bag(kind))
    target = packed(file, f"alone{file.suffix}.zstd", tmp_path)
    assert len(list(open_recording(target))) == 5
    assert [path.name for path in tmp_path.glob("alone*")] == [target.name]


def test_a_packed_file_in_its_folder(write_bag: Writer) -> None:
    path = write_bag("mcap")
    file = storage(path)
    packed(file, f"{file.name}.zstd", path)
    assert len(list(open_recording(path))) == 5  # not twice, with both there
    file.unlink()
    source = open_recording(path)
    assert len(list(source)) == 5
    assert not source.counts["files missing"]


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_messages_that_are_packed_one_by_one(bags: Any, tmp_path: Path, kind: str) -> None:
    class Packing(bags.BagFile):
        def write(self, topic: str, kind: str, message: Any, log_ns: int) -> None:
            self.add_topic(topic, kind)
            data = zstandard.ZstdCompressor().compress(
                bytes(self.store.serialize_cdr(message, kind))
            )
            self._writer.write(self._connections[topic], log_ns, data)

    with Packing(tmp_path, kind) as bag:
        for number in range(3):
            stamp = bags.START_NS + number * bags.PERIOD_NS
            bag.image(bags.COLOUR, bags.small_frame(number).image, stamp)
    frames = list(open_recording(storage(bag.path)))
    assert len(frames) == 3
    np.testing.assert_array_equal(frames[1].image, bags.small_frame(1).image)


def crashed(path: Path, folder: Path) -> Path:
    """A database of which half of the messages are only in the log beside it."""
    file = storage(path)
    target = folder / "crashed.db3"
    shutil.copy(file, target)
    database = sqlite3.connect(target)
    half = database.execute("SELECT COUNT(*) / 2 FROM messages").fetchone()[0]
    rows = database.execute("SELECT * FROM messages ORDER BY id").fetchall()
    database.execute("DELETE FROM messages WHERE id > ?", (rows[half - 1][0],))
    database.commit()
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("PRAGMA wal_autocheckpoint=0")
    places = ",".join("?" * len(rows[0]))
    database.executemany(f"INSERT INTO messages VALUES ({places})", rows[half:])
    database.commit()
    copies = [Path(f"{target}{end}").read_bytes() for end in ("", "-wal")]
    database.close()  # which would empty the log
    for end in ("-wal", "-shm"):
        Path(f"{target}{end}").unlink(missing_ok=True)
    for end, content in zip(("", "-wal"), copies, strict=True):
        Path(f"{target}{end}").write_bytes(content)
    return target


@pytest.mark.parametrize("share", [0.4, 0.7, 0.95])
def test_a_database_without_its_end_is_read_up_to_there(
    write_bag: Writer, tmp_path: Path, caplog: pytest.LogCaptureFixture, share: float
) -> None:
    whole = storage(write_bag("sqlite3", 40))
    expected = [frame.time_s for frame in open_recording(whole)]
    file = tmp_path / "short.db3"
    content = whole.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    source = open_recording(file)
    times = [frame.time_s for frame in source]
    assert 0.5 * share < len(times) / len(expected) < 1
    assert times == expected[: len(times)]
    assert source.counts["end missing"] == 1
    assert f"recording {file}: its end is missing" in caplog.text


def test_the_log_beside_a_database_is_read_and_the_files_stay(
    write_bag: Writer, tmp_path: Path
) -> None:
    folder = tmp_path / "crash"
    folder.mkdir()
    file = crashed(write_bag("sqlite3", 10), folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    folder.chmod(0o500)
    try:
        source = open_recording(file)
        assert len(list(source)) == 10
    finally:
        folder.chmod(0o700)
    assert not source.counts["end missing"]
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.mcap", b"\x1f\x8b" + bytes(50), "packed by gzip, expected it unpacked"),
        ("a.bag", b"\x04\x22\x4d\x18" + bytes(50), "packed by lz4"),
        ("a.db3", b"PK\x03\x04" + bytes(50), "a zip archive"),
        ("a.bag", bytes(50), "expected a ROS 1 bag, ROS 2 bag or MCAP file"),
        ("a.mcap.zstd", b"nothing", "expected a ROS 1 bag, ROS 2 bag or MCAP file"),
        ("a.mcap.zstd", b"\x28\xb5\x2f\xfd" + bytes(50), "cannot be read"),
        ("a.svo2", bytes(50), "a recording of a ZED camera"),
        ("a.rrd", bytes(50), "a recording of Rerun"),
    ],
)
def test_what_is_not_read_is_named(tmp_path: Path, name: str, content: bytes, told: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=told) as refused:
        open_recording(path)
    assert str(path) in str(refused.value)


def test_a_file_that_is_packed_twice_is_refused(write_bag: Writer, tmp_path: Path) -> None:
    once = packed(storage(write_bag("mcap")), "a.mcap.zstd", tmp_path)
    with pytest.raises(InputError, match="packed twice"):
        open_recording(packed(once, "b.mcap.zstd", tmp_path))


def test_an_empty_part_of_a_split_recording_is_told(
    bags: Any, write_bag: Writer, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    shutil.copy(storage(write_bag("mcap")), folder / "drive_0.mcap")
    (folder / "drive_1.mcap").touch()
    source = open_recording(folder)
    assert len(list(source)) == 5
    assert source.counts["files empty"] == 1
    assert "its file drive_1.mcap is empty" in caplog.text


def test_a_file_without_its_end_is_read_up_to_a_broken_chunk(bags: Any, tmp_path: Path) -> None:
    path = tmp_path / "crashed.mcap"
    with Ros1InMcap(path, chunk_size=10_000) as bag:
        for number in range(8):
            frame, stamp = bags.small_frame(number), bags.START_NS + number * bags.PERIOD_NS
            bag.image(bags.COLOUR, frame.image, stamp)
    content = path.read_bytes()
    half = len(content) // 2
    # As a disk leaves it that wrote the length of a file, and not all of its blocks.
    path.write_bytes(content[:half] + bytes(len(content) - half))
    source = open_recording(path)
    assert 2 <= len(list(source)) <= 5
    assert source.counts["end missing"] == 1


def test_a_first_message_that_is_broken_does_not_cost_its_topic(bags: Any, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with Ros1InMcap(path) as bag:
        schema = ("sensor_msgs/Image", "ros1msg", b"")
        bag.mcap.add(bags.DEPTH, schema, "ros1", b"\1\2", bags.START_NS - 1)
        for number in range(3):
            frame, stamp = bags.small_frame(number), bags.START_NS + number * bags.PERIOD_NS
            bag.image(bags.COLOUR, frame.image, stamp)
            bag.image(bags.DEPTH, frame.depth, stamp, "16UC1")
    source = open_recording(path)
    assert [frame.depth_m is not None for frame in source] == [True] * 3
    assert source.counts["unreadable messages"] == 1


@pytest.mark.parametrize("kind", ["mcap", "ros1"])
@pytest.mark.parametrize("name", ["no_suffix", "drive.dat", "drive.bag.orig", "drive.mcap.part"])
def test_a_recording_of_any_name_is_told_by_its_first_bytes(
    write_bag: Writer, tmp_path: Path, kind: str, name: str
) -> None:
    file = shutil.copy(storage(write_bag(kind)), tmp_path / name)
    assert is_bag(file)
    (tmp_path / "other.dat").write_bytes(b"something else")
    assert not is_bag(tmp_path / "other.dat")


@pytest.mark.parametrize("end", ["gz", "lz4", "bz2", "xz", "zip"])
def test_recordings_packed_by_other_programs_are_told(tmp_path: Path, end: str) -> None:
    magic = {"gz": b"\x1f\x8b", "lz4": b"\x04\x22\x4d\x18", "bz2": b"BZh"}
    others = {"xz": b"\xfd7zXZ", "zip": b"PK\x03\x04"}
    path = tmp_path / f"drive.mcap.{end}"
    path.write_bytes((magic | others)[end] + bytes(20))
    assert is_bag(path)
    with pytest.raises(InputError, match=r"it is (packed by|a zip).*expected it unpacked"):
        open_recording(path)


@pytest.mark.parametrize("kind", ["mcap", "ros1"])
def test_a_file_of_which_nothing_is_complete_is_told(
    write_bag: Writer, tmp_path: Path, kind: str
) -> None:
    content = storage(write_bag(kind)).read_bytes()
    path = tmp_path / f"cut.{'bag' if kind == 'ros1' else 'mcap'}"
    path.write_bytes(content[:6000])
    with pytest.raises(InputError, match="its end is missing, and no part before it is complete"):
        open_recording(path)
