"""Video in recordings: H.264 and H.265 in three types of messages."""

from __future__ import annotations

import builtins
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from packets import moving_pictures, video_packets

from basetree.errors import InputError, MissingPackage
from basetree.files import current_limits, set_limits
from edgetree.sources.bags.h264_numbers import FrameNumbers
from edgetree.sources.bags.recording import open_recording
from edgetree.sources.bags.video_packets import (
    DEFINITIONS,
    FFMPEG_TYPE,
    FOXGLOVE_TYPE,
    codec_of,
)

COUNT = 12
TOPIC = "/cam/color/image_raw"
BEFORE = "video packets before a key frame"


@pytest.fixture(autouse=True)
def av() -> Any:
    return pytest.importorskip("av")


@pytest.fixture
def pictures() -> list[np.ndarray]:
    return moving_pictures(COUNT)


def messages(bag: Any, kind: str, packets: list[bytes], form: str, bags: Any) -> Iterator[Any]:
    from rosbags.typesys import get_types_from_msg

    for name, text in DEFINITIONS.items():
        if name not in bag.store.fielddefs:
            bag.store.register(get_types_from_msg(text, name))
    for number, packet in enumerate(packets):
        stamp = bags.START_NS + number * bags.PERIOD_NS
        header, data = bag.header(stamp, bags.FRAME), np.frombuffer(packet, np.uint8)
        if kind == FFMPEG_TYPE:
            rest = {"width": 96, "height": 64, "pts": number, "flags": 0, "is_bigendian": False}
            yield stamp, bag.message(kind, header=header, encoding=form, data=data, **rest)
        elif kind == FOXGLOVE_TYPE:
            fields = {"timestamp": header.stamp, "frame_id": bags.FRAME, "format": form}
            yield stamp, bag.message(kind, data=data, **fields)
        else:
            yield stamp, bag.message(kind, header=header, format=form, data=data)


def write(
    bags: Any,
    folder: Path,
    packets: list[bytes],
    kind: str = "sensor_msgs/msg/CompressedImage",
    form: str = "h264",
    depth_of: range = range(0),
) -> Path:
    with bags.BagFile(folder) as bag:
        for number, (stamp, message) in enumerate(messages(bag, kind, packets, form, bags)):
            bag.write(TOPIC, kind, message, stamp)
            if number in depth_of:
                depth = np.full((64, 96), 2000 + number, np.uint16)
                bag.image(bags.DEPTH, depth, stamp, "16UC1")
    path: Path = bag.path
    return path


def shown(image: np.ndarray | None) -> int:
    """Number of the picture that an image is most like."""
    assert image is not None
    off = [np.abs(image.astype(int) - picture).mean() for picture in moving_pictures(COUNT)]
    assert min(off) < 4
    return int(np.argmin(off))


@pytest.mark.parametrize("codec", ["h264", "hevc"])
@pytest.mark.parametrize(
    ("kind", "form"),
    [
        ("sensor_msgs/msg/CompressedImage", "{}"),
        ("sensor_msgs/msg/CompressedImage", "bgr8; {} compressed"),
        (FFMPEG_TYPE, "{}"),
        (FFMPEG_TYPE, "{};yuv420p;bgr8;bgr8"),
        (FOXGLOVE_TYPE, "{}"),
    ],
)
def test_packets_become_pictures(
    bags: Any, tmp_path: Path, pictures: list[np.ndarray], codec: str, kind: str, form: str
) -> None:
    packets = video_packets(pictures, codec)
    frames = list(open_recording(write(bags, tmp_path, packets, kind, form.format(codec))))
    assert [frame.number for frame in frames] == list(range(COUNT))
    assert [shown(frame.image) for frame in frames] == list(range(COUNT))


@pytest.mark.parametrize(
    ("form", "codec"),
    [
        ("h264", "h264"),
        ("H264", "h264"),
        ("h265", "hevc"),
        ("libx264", "h264"),
        ("hevc_nvenc", "hevc"),
        ("h264_vaapi", "h264"),
        ("video/avc", "h264"),
        ("jpeg", None),
        ("bgr8; jpeg compressed bgr8", None),
        ("vp9", None),
        ("", None),
    ],
)
def test_names_of_codes(form: str, codec: str | None) -> None:
    assert codec_of(form) == codec


def test_pictures_without_a_partner_are_decoded_for_those_after_them(
    bags: Any, tmp_path: Path, pictures: list[np.ndarray]
) -> None:
    depth_of = range(5, 10)
    source = open_recording(write(bags, tmp_path, video_packets(pictures), depth_of=depth_of))
    frames = list(source)
    assert len(frames) == len(depth_of)
    for frame, number in zip(frames, depth_of, strict=True):
        assert shown(frame.image) == number
        assert frame.depth_m is not None
        assert frame.depth_m[0, 0] == pytest.approx(2 + number / 1000)


def test_what_comes_before_the_first_key_frame_is_counted(
    bags: Any, tmp_path: Path, pictures: list[np.ndarray]
) -> None:
    packets = video_packets(pictures, key_every=5)[2:]
    source = open_recording(write(bags, tmp_path, packets))
    frames = list(source)
    assert source.counts[BEFORE] == 3
    assert [shown(frame.image) for frame in frames] == list(range(5, COUNT))


@pytest.mark.parametrize("codec", ["h264", "hevc"])
@pytest.mark.parametrize("lost", [1, 2, 3])
def test_packets_that_are_lost_give_no_wrong_pictures(
    bags: Any, tmp_path: Path, pictures: list[np.ndarray], codec: str, lost: int
) -> None:
    packets = video_packets(pictures, codec, key_every=6)
    source = open_recording(write(bags, tmp_path, packets[:2] + packets[2 + lost :], form=codec))
    assert [shown(frame.image) for frame in source] == [0, 1, 6, 7, 8, 9, 10, 11]
    assert source.counts["unreadable images"] == 4 - lost


@pytest.mark.parametrize("profile", ["baseline", "main", "high"])
def test_whole_streams_of_all_profiles_have_no_gaps(profile: str) -> None:
    numbers = FrameNumbers()
    packets = video_packets(moving_pictures(40), profile=profile)  # numbers start again at 16
    assert [numbers.is_gap(packet) for packet in packets] == [False] * 40
    numbers = FrameNumbers()
    found = [numbers.is_gap(packet) for packet in packets[:20] + packets[21:]]
    assert found == [False] * 20 + [True] + [False] * 18


@pytest.mark.parametrize(
    "packet", [b"", b"\0\0\1", b"\0\0\1\x67", b"\0\0\1\x67" + bytes(80), b"\0\0\1\x41" * 9]
)
def test_numbers_of_broken_packets_do_no_harm(packet: bytes) -> None:
    numbers = FrameNumbers()
    numbers.is_gap(video_packets(moving_pictures(1))[0])
    assert numbers.is_gap(packet) in (True, False)
    assert numbers.is_gap(packet[:-1] + b"\xff" * 70) in (True, False)


@pytest.mark.parametrize("codec", ["h264", "hevc"])
def test_broken_packets_are_counted(
    bags: Any, tmp_path: Path, pictures: list[np.ndarray], codec: str
) -> None:
    packets = video_packets(pictures, codec, key_every=1)
    packets[3] = os.urandom(500)
    packets[4] = b""
    packets[5] = packets[5][:40]
    source = open_recording(write(bags, tmp_path, packets, form=codec))
    frames = list(source)
    assert COUNT - 3 <= len(frames) <= COUNT - 2
    assert source.counts["unreadable images"] == COUNT - len(frames)
    assert shown(frames[-1].image) == COUNT - 1


def test_pictures_in_another_order_than_their_packets_are_refused(
    bags: Any, tmp_path: Path, pictures: list[np.ndarray]
) -> None:
    packets = video_packets(pictures, b_frames=2)
    with pytest.raises(InputError, match="expected video without B frames"):
        list(open_recording(write(bags, tmp_path, packets)))


def test_no_key_frame_at_all_is_said(bags: Any, tmp_path: Path, pictures: list[np.ndarray]) -> None:
    source = open_recording(write(bags, tmp_path, video_packets(pictures)[1:]))
    with pytest.raises(InputError, match=rf"no picture could be decoded \({COUNT - 1} {BEFORE}\)"):
        list(source)


@pytest.mark.parametrize(("kind", "form"), [(FFMPEG_TYPE, "vp9"), (FOXGLOVE_TYPE, "av1")])
def test_other_codes_are_named(bags: Any, tmp_path: Path, kind: str, form: str) -> None:
    with pytest.raises(InputError, match=rf"{form}.*its code is not read, expected h264 or h265"):
        open_recording(write(bags, tmp_path, [b"1234"], kind, form))


def test_the_missing_package_is_named(
    bags: Any, tmp_path: Path, pictures: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    source = open_recording(write(bags, tmp_path, video_packets(pictures)))
    load = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name == "av":
            raise ImportError(name)
        return load(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(
        MissingPackage, match=r"PyAV is not installed, which video of h264.*video\]"
    ):
        list(source)


def test_pictures_above_the_limit_are_refused(
    bags: Any, tmp_path: Path, pictures: list[np.ndarray]
) -> None:
    source = open_recording(write(bags, tmp_path, video_packets(pictures)))
    before = set_limits(replace(current_limits(), image_pixels=96 * 64 - 1))
    try:
        with pytest.raises(InputError, match="no picture could be decoded"):
            list(source)
    finally:
        set_limits(before)
