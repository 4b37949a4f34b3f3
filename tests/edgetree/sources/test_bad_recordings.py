"""Recordings that are cut off, incomplete or inconsistent: one clear line, or a count."""

from __future__ import annotations

import builtins
import logging
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calib
from basetree.errors import InputError, MissingPackage
from edgetree.sources.bags.recording import open_recording

Writer = Callable[..., Path]
FRAMES = 12


def cut(path: Path, share: float) -> Path:
    """The file of a recording, cut off."""
    file = next(path.iterdir(), path) if path.is_dir() else path
    if path.is_dir():
        (path / "metadata.yaml").unlink()
        (file,) = path.iterdir()
    data = file.read_bytes()
    file.write_bytes(data[: round(len(data) * share)])
    return file


def test_a_cut_off_mcap_file_is_read_as_far_as_it_goes(
    bags: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with bags.BagFile(tmp_path, "mcap") as bag:
        noise = np.random.default_rng(0).integers(0, 256, (400, 640, 3), np.uint8)
        for number in range(FRAMES):
            stamp = bags.START_NS + number * bags.PERIOD_NS
            late = bags.PERIOD_NS if number % 3 == 0 else 0  # recorded out of order
            bag.image(bags.COLOUR, noise, stamp, log_ns=stamp + 2 * late)
    file = cut(bag.path, 0.6)
    with file.open("ab") as end:
        end.write(bytes(10**7))  # as some file systems leave it
    source = open_recording(file)
    frames = list(source)
    assert 3 < len(frames) < FRAMES
    assert source.counts["end missing"] == 1
    assert "its end is missing: what is there is read" in caplog.text


@pytest.mark.parametrize(
    ("share", "compression"),
    [(0.2, None), (0.6, None), (0.9, None), (0.999, None), (0.6, "BZ2"), (0.6, "LZ4")],
)
def test_a_cut_off_ros_1_bag_is_read_as_far_as_it_goes(
    bags: Any, tmp_path: Path, share: float, compression: str | None
) -> None:
    from rosbags.rosbag1 import Writer as RosWriter

    bag = bags.BagFile(tmp_path, "ros1")
    bag._writer.chunk_threshold = 10_000  # one or two pictures
    if compression is not None:
        bag._writer.set_compression(RosWriter.CompressionFormat[compression])
    noise = np.random.default_rng(0).integers(0, 256, (FRAMES, 48, 64, 3), np.uint8)
    with bag:
        for number in range(FRAMES):
            stamp = bags.START_NS + number * bags.PERIOD_NS
            bag.image(bags.COLOUR, noise[number], stamp)
            if number:
                bag.info(bags.INFO, bags.small_frame().camera, stamp)
    source = open_recording(cut(bag.path, share))
    frames = list(source)
    assert share * FRAMES - 4 < len(frames) <= FRAMES
    assert len(frames) >= 1
    assert source.counts["end missing"] == 1
    for number, live in enumerate(frames):
        np.testing.assert_array_equal(live.image, noise[number])


def test_a_ros_1_bag_that_is_not_closed_is_read(write_bag: Writer) -> None:
    path = write_bag("ros1")
    data = bytearray(path.read_bytes())
    at = data.index(b"index_pos=") + len(b"index_pos=")
    end = int.from_bytes(data[at : at + 8], "little")
    data[at : at + 8] = bytes(8)
    path.write_bytes(data[:end])
    source = open_recording(path)
    assert len(list(source)) == 5
    assert source.counts["end missing"] == 1


def test_a_ros_1_bag_without_one_complete_chunk_is_refused(write_bag: Writer) -> None:
    path = write_bag("ros1")
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(InputError, match=r"drive\.bag cannot be read: its end is missing, and no"):
        open_recording(path)


def test_a_broken_part_ends_the_recording_and_is_counted(
    bags: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with bags.BagFile(tmp_path, "sqlite3") as bag:
        noise = np.random.default_rng(0).integers(0, 256, (200, 320, 3), np.uint8)
        for number in range(FRAMES):
            bag.image(bags.COLOUR, noise, bags.START_NS + number * bags.PERIOD_NS)
    data = bytearray(bag.file.read_bytes())
    page = len(data) // 2 // 4096 * 4096  # inside of a picture; it begins with the next page
    data[page : page + 4] = b"\xff\xff\xff\xff"
    bag.file.write_bytes(data)
    source = open_recording(bag.path)
    frames = list(source)
    assert 0 < len(frames) < FRAMES
    assert source.counts["ended early"] == 1
    assert "malformed" in caplog.text
    assert "the frames before were read" in caplog.text


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("a.bag", b"", "is empty"),
        ("a.bag", b"#ROSBAG V1.2\n", "cannot be read"),
        ("a.mcap", b"nothing of the kind", "cannot be read"),
        ("a.db3", b"SQLite format 3\0" + bytes(100), "cannot be read"),
        ("a.mcap", None, "does not exist"),
    ],
)
def test_files_that_are_no_recordings(
    bags: Any, tmp_path: Path, name: str, content: bytes | None, expected: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=expected) as refused:
        open_recording(path)
    assert str(path) in str(refused.value)
    assert "expected" in str(refused.value)


def test_a_missing_package_is_named_with_the_command(
    write_bag: Writer, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_bag()
    load = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("rosbags"):
            raise ImportError(name)
        return load(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingPackage, match=r"rosbags is not installed.*\[record\]"):
        open_recording(path)


def test_topics_that_are_missing_or_empty_or_of_another_type(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
        bag.info(bags.INFO, frame.camera, bags.START_NS)
        bag.add_topic(bags.DEPTH, "sensor_msgs/msg/Image")
    for topics, expected in (
        ({"colour": "/nowhere"}, f"/nowhere for colour does not exist: expected {bags.COLOUR}"),
        ({"colour": bags.INFO}, "is of sensor_msgs/msg/CameraInfo: expected"),
        ({"depth": bags.DEPTH}, f"topic {bags.DEPTH} is empty"),
        ({"color": bags.COLOUR}, "topics names color: expected colour, depth"),
        ({"imu": "/imu"}, "expected a topic of sensor_msgs/msg/Imu, and there is none"),
    ):
        with pytest.raises(InputError, match=expected):
            open_recording(bag.path, topics=topics)
    with pytest.raises(InputError, match="has no depth images"):
        open_recording(bag.path, modality="depth")
    assert len(list(open_recording(bag.path))) == 1  # the empty depth is left out


def test_two_cameras_are_listed_and_one_can_be_named(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        for side in ("left", "right"):
            bag.image(f"/{side}/image_raw", frame.image, bags.START_NS, frame=side)
    expected = "2 topics of colour images: expected one .*: /left/image_raw, /right/image_raw"
    with pytest.raises(InputError, match=expected):
        open_recording(bag.path)
    assert len(list(open_recording(bag.path, topics={"colour": "/right/image_raw"}))) == 1


def test_raw_images_are_preferred_to_compressed_ones(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        jpeg = cv2.imencode(".jpg", frame.image)[1].tobytes()
        bag.packed(f"{bags.COLOUR}/compressed", jpeg, "bgr8; jpeg compressed bgr8", bags.START_NS)
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
    (live,) = open_recording(bag.path)
    np.testing.assert_array_equal(live.image, frame.image)
    (packed,) = open_recording(bag.path, topics={"colour": f"{bags.COLOUR}/compressed"})
    assert packed.image is not None
    assert not np.array_equal(packed.image, frame.image)


def test_aligned_depth_is_preferred_to_that_of_another_frame(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
        bag.image("/cam/depth/image_rect_raw", frame.depth, bags.START_NS, "16UC1", "depth_frame")
        bag.image("/cam/aligned_depth/image_raw", 2 * frame.depth, bags.START_NS, "16UC1")
    (live,) = open_recording(bag.path)
    np.testing.assert_allclose(live.depth_m, frame.depth / 500, rtol=1e-6)


def test_pictures_without_a_partner_are_counted(bags: Any, tmp_path: Path) -> None:
    with bags.BagFile(tmp_path) as bag:
        for number in range(FRAMES):
            frame = bags.small_frame(number)
            stamp = bags.START_NS + number * bags.PERIOD_NS
            if number != 3:
                bag.image(bags.COLOUR, frame.image, stamp)
            if number not in (5, 6):
                # A depth that is late by less than half a period is of the same moment.
                bag.image(bags.DEPTH, frame.depth, stamp + 40_000_000, "16UC1")
    source = open_recording(bag.path)
    frames = list(source)
    assert len(frames) == FRAMES - 3
    assert source.counts["colour without depth"] == 2
    assert source.counts["depth without colour"] == 1
    shades = [float(frame.depth_m[0, 0]) for frame in frames if frame.depth_m is not None]
    np.testing.assert_allclose(shades, 2 + 0.001 * np.array([0, 1, 2, 4, 7, 8, 9, 10, 11]))


def test_depth_of_another_clock_is_refused(write_bag: Writer) -> None:
    source = open_recording(write_bag(depth_delay_ns=40 * 10**9))
    with pytest.raises(InputError, match=r"have time stamps within half a period \(5 colour"):
        list(source)


def test_a_clock_that_jumps_back_goes_on_rising(bags: Any, tmp_path: Path) -> None:
    with bags.BagFile(tmp_path) as bag:
        for number in range(FRAMES):
            frame = bags.small_frame(number)
            log_ns = bags.START_NS + number * bags.PERIOD_NS
            stamp = log_ns - (100 * 10**9 if number >= 6 else 0)
            bag.image(bags.COLOUR, frame.image, stamp, log_ns=log_ns)
            bag.image(bags.DEPTH, frame.depth, stamp, "16UC1", log_ns=log_ns)
    source = open_recording(bag.path)
    times = [frame.time_s for frame in source]
    assert len(times) >= FRAMES - 1
    assert np.diff(times).min() > 0
    assert times[-1] - times[0] < 2
    assert source.counts["clock jumped back"] == 1


def test_stamps_that_repeat_or_come_late_are_counted(bags: Any, tmp_path: Path) -> None:
    with bags.BagFile(tmp_path) as bag:
        frame = bags.small_frame()
        for number, at in enumerate((0, 1, 1, 3, 2, 4)):
            log_ns = bags.START_NS + number * bags.PERIOD_NS
            stamp = bags.START_NS + at * bags.PERIOD_NS
            bag.image(bags.COLOUR, frame.image, stamp, log_ns=log_ns)
    source = open_recording(bag.path)
    assert len(list(source)) == 4
    assert source.counts["colour with a repeated or late stamp"] == 2


def test_stamps_that_a_driver_does_not_set_are_those_of_the_recording(
    bags: Any, tmp_path: Path
) -> None:
    with bags.BagFile(tmp_path) as bag:
        for number in range(3):
            log_ns = bags.START_NS + number * bags.PERIOD_NS
            bag.image(bags.COLOUR, bags.small_frame().image, 0, log_ns=log_ns)
    times = [frame.time_s - bags.START_NS / 1e9 for frame in open_recording(bag.path)]
    np.testing.assert_allclose(times, [0, 0.1, 0.2], atol=1e-5)


def test_a_camera_that_changes_its_resolution(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    small = calib.PinholeCamera(32, 24, 33.0, 33.0, 15.5, 11.5)
    with bags.BagFile(tmp_path) as bag:
        for number in range(6):
            stamp = bags.START_NS + number * bags.PERIOD_NS
            step, camera = (1, frame.camera) if number < 3 else (2, small)
            if number == 5:
                step = 1  # a late picture of the former size
            bag.info(bags.INFO, camera, stamp)
            bag.image(bags.COLOUR, frame.image[::step, ::step], stamp)
            bag.image(bags.DEPTH, frame.depth[::step, ::step], stamp, "16UC1")
    frames = list(open_recording(bag.path))
    expected = [frame.camera] * 3 + [small] * 2 + [frame.camera]
    assert [live.camera for live in frames] == expected
    for live in frames:
        assert live.image is not None
        assert live.depth_m is not None
        assert live.image.shape[:2] == live.depth_m.shape


def test_unreadable_images_are_counted(
    bags: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
        short = frame.image.ravel()[:100]
        bag.image(bags.COLOUR, frame.image, bags.START_NS + 10**8, data=short)
        bag.image(bags.COLOUR, frame.image, bags.START_NS + 2 * 10**8, "yuv_strange")
        bag.write(
            bags.COLOUR,
            "sensor_msgs/msg/Image",
            bag.message(
                "sensor_msgs/msg/Image",
                header=bag.header(bags.START_NS + 3 * 10**8, ""),
                height=2**31,
                width=2**31,
                encoding="bgr8",
                is_bigendian=0,
                step=0,
                data=np.zeros(4, np.uint8),
            ),
            bags.START_NS + 3 * 10**8,
        )
        bag.image(bags.COLOUR, frame.image, bags.START_NS + 4 * 10**8)
    with caplog.at_level(logging.WARNING):
        source = open_recording(bag.path)
        frames = list(source)
    assert [frame.number for frame in frames] == [0, 4]
    assert source.counts["unreadable images"] == 3
    assert "has 100 bytes in rows of 192" in caplog.text
    assert "its encoding is 'yuv_strange', expected bgr8" in caplog.text


def test_messages_of_broken_bytes_are_counted(write_bag: Writer) -> None:
    path = write_bag("sqlite3", name="broken")
    (file,) = path.glob("*.db3")
    with sqlite3.connect(file) as database:
        (last,) = database.execute("SELECT max(id) FROM messages WHERE topic_id = 1").fetchone()
        database.execute("UPDATE messages SET data = x'0001' WHERE id = ?", (last,))
    database.close()
    source = open_recording(path)
    assert len(list(source)) == 4
    assert source.counts["unreadable messages"] == 1


def test_an_uncalibrated_camera_is_said(
    bags: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.info(bags.INFO, frame.camera, bags.START_NS, k=np.zeros(9), p=np.zeros(12))
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
    (live,) = open_recording(bag.path)
    assert live.camera is None
    assert "ROS's mark of an uncalibrated camera" in caplog.text
