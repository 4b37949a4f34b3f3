"""Which topic is depth, which is colour, and what is said of those that are left out."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from basetree.errors import InputError
from edgetree.sources.bags.recording import open_recording

pytest.importorskip("mcap")
from mcap_files import McapOf

Write = Callable[..., Path]


@pytest.fixture
def write(bags: Any, tmp_path: Path) -> Write:
    """A function that writes a picture of colour and one of one channel, and returns the path."""

    def written(
        topic: str, encoding: str = "16UC1", frame: str = "cam", *, with_colour: bool = True
    ) -> Path:
        small = bags.small_frame()
        with bags.BagFile(tmp_path) as bag:
            if with_colour:
                bag.image(bags.COLOUR, small.image, bags.START_NS, frame="cam")
            if encoding == "png":
                png = cv2.imencode(".png", small.depth)[1].tobytes()
                bag.packed(
                    f"{topic}/compressed", png, "16UC1; png compressed", bags.START_NS, frame
                )
            elif encoding == "bare png":
                png = cv2.imencode(".png", small.depth)[1].tobytes()
                bag.packed(f"{topic}/compressed", png, "png", bags.START_NS, frame)
            elif encoding == "compressedDepth":
                png = bags.depth_png(small.depth)
                form = "16UC1; compressedDepth png"
                bag.packed(f"{topic}/compressedDepth", png, form, bags.START_NS, frame)
            else:
                values = small.depth
                if encoding in ("32FC1", "64FC1"):
                    values = (values / 1000).astype(np.float32 if encoding == "32FC1" else float)
                bag.image(topic, values, bags.START_NS, encoding, frame)
        path: Path = bag.path
        return path

    return written


OTHERS = ("/thermal/image_raw", "/ir/image", "/camera/infra1/image", "/lwir/image", "/boson/image")


@pytest.mark.parametrize("topic", [*OTHERS, "/camera/depth/confidence", "/camera/disparity"])
@pytest.mark.parametrize("encoding", ["16UC1", "mono16", "32FC1", "png", "bare png"])
def test_pictures_of_other_things_are_no_depth(
    write: Write, caplog: pytest.LogCaptureFixture, topic: str, encoding: str
) -> None:
    (frame,) = open_recording(write(topic, encoding))
    assert frame.image is not None
    assert frame.depth_m is None
    assert f"has no depth; topic {topic}" in caplog.text
    assert f"in its name is no depth: expected --topic depth={topic}" in caplog.text


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1", "64FC1", "16SC1", "png", "bare png"])
def test_a_name_that_tells_nothing_asks_for_the_topic(
    bags: Any, write: Write, caplog: pytest.LogCaptureFixture, encoding: str
) -> None:
    path = write("/camera/image_raw", encoding)
    (frame,) = open_recording(path)
    assert frame.depth_m is None
    assert "nothing in its name or frame tells whether it is depth: expected --topic" in caplog.text
    (named,) = open_recording(path, topics={"depth": "/camera/image_raw"})
    assert named.depth_m is not None
    np.testing.assert_allclose(named.depth_m, bags.small_frame().depth / 1000, rtol=1e-6)


@pytest.mark.parametrize(
    ("topic", "encoding", "frame"),
    [
        ("/camera/depth/image_raw", "mono16", "cam"),
        ("/camera/depth/image_raw", "16SC1", "cam"),
        ("/camera/depth/image_raw", "64FC1", "cam"),
        ("/camera/depth/image_raw", "png", "cam"),
        ("/camera/depth/image_raw", "bare png", "cam"),
        ("/stereo/image_raw", "16UC1", "cam"),
        ("/camera/image_raw", "Z16", "cam"),
        ("/camera/image_raw", "compressedDepth", "cam"),
        ("/camera/image_raw", "32FC1", "camera_depth_optical_frame"),
    ],
)
def test_depth_is_found_by_topic_frame_or_format(
    write: Write, topic: str, encoding: str, frame: str
) -> None:
    (live,) = open_recording(write(topic, encoding, frame), modality="depth")
    assert live.depth_m is not None
    assert live.depth_m[0, 0] == pytest.approx(2.0)


def test_depth_is_found_by_the_frame_of_its_camera(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.image("/camera/image", frame.depth, bags.START_NS, "16UC1", frame="")
        bag.info("/camera/camera_info", frame.camera, bags.START_NS, "depth_optical_frame")
    (live,) = open_recording(bag.path)
    assert live.depth_m is not None


def test_thermal_pictures_alone_are_refused_with_the_way_to_name_them(write: Write) -> None:
    path = write("/thermal/image_raw", with_colour=False)
    with pytest.raises(InputError, match=r"has no images.*/thermal/image_raw \(16UC1\).*no depth"):
        open_recording(path)


@pytest.mark.parametrize("modality", ["both", "rgb"])
def test_colour_that_is_not_read_is_named_with_its_encoding(
    bags: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture, modality: Any
) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.DEPTH, frame.depth, bags.START_NS, "16UC1")
        bag.image(bags.COLOUR, frame.image, bags.START_NS, "nv24")
    line = f"topic {bags.COLOUR} (nv24) is left out: its encoding is not read, expected bgr8, bgr16"
    if modality == "both":
        (live,) = open_recording(bag.path)
        assert live.depth_m is not None
        assert f"has no colour; {line}" in caplog.text
    else:
        with pytest.raises(InputError, match=r"has no colour images.*nv24.*expected bgr8, bgr16"):
            open_recording(bag.path, modality="rgb")


def test_pictures_of_other_types_are_named(
    bags: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frame = bags.small_frame()
    kind = "stereo_msgs/msg/DisparityImage"
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
        bag.add_topic("/stereo/disparity", kind)
    open_recording(bag.path)
    assert f"topic /stereo/disparity is left out: it is of {kind}, expected sensor_" in caplog.text


@pytest.mark.parametrize("encoding", ["8UC1", "mono8"])
def test_depth_of_8_bits_is_named(
    bags: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture, encoding: str
) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.COLOUR, frame.image, bags.START_NS)
        bag.image(bags.DEPTH, (frame.depth // 30).astype(np.uint8), bags.START_NS, encoding)
    (live,) = open_recording(bag.path)
    assert live.depth_m is None
    line = f"topic {bags.DEPTH} ({encoding}) is left out: it has 8 bits, expected 16UC1, mono16"
    assert f"has no depth; {line}" in caplog.text


@pytest.mark.parametrize(("schema", "encoding"), [("foxglove.RawImage", "cbor"), ("my.A", "json")])
def test_messages_of_another_encoding_are_named_with_it(
    tmp_path: Path, schema: str, encoding: str
) -> None:
    path = tmp_path / "drive.mcap"
    with McapOf(path) as mcap:
        mcap.add("/cam/depth", (schema, "", b""), encoding, b"{}", 1)
    with pytest.raises(InputError, match=rf"/cam/depth \({schema} in {encoding}"):
        open_recording(path)


def test_nothing_is_said_if_nothing_lacks(write: Write, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        (frame,) = open_recording(write("/camera/depth/image"))
    assert frame.image is not None
    assert frame.depth_m is not None
    assert "left out" not in caplog.text


def test_16_bits_without_a_name_are_grey_if_there_is_no_colour(bags: Any, tmp_path: Path) -> None:
    values = np.arange(48 * 64, dtype=np.uint16).reshape(48, 64)  # of 12 bits
    with bags.BagFile(tmp_path) as bag:
        bag.image("/camera/image_raw", values, bags.START_NS, "mono16")
    (frame,) = open_recording(bag.path)
    assert frame.image is not None
    np.testing.assert_array_equal(frame.image[..., 1], values >> 4)


@pytest.mark.parametrize(
    "data",
    [
        b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(100),  # JPEG 2000
        b"P6 60000 60000 255\n" + bytes(100),
        b"#?RADIANCE\n\n-Y 60000 +X 60000\n",
    ],
)
def test_formats_whose_size_cannot_be_checked_are_refused(
    bags: Any, tmp_path: Path, data: bytes
) -> None:
    with bags.BagFile(tmp_path) as bag:
        bag.packed(f"{bags.COLOUR}/compressed", data, "picture", bags.START_NS)
    with pytest.raises(InputError, match=r"cannot be decoded: the picture: "):
        list(open_recording(bag.path))
