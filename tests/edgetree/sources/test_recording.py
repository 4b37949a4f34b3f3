"""Recordings: all three kinds give the frames that files give; topics, units and pairing."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calib
import edgetree
from basetree.errors import InputError
from edgetree.sources.bags.recording import open_recording

KINDS = ("ros1", "sqlite3", "mcap")
Writer = Callable[..., Path]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("is_packed", [False, True])
def test_a_recording_gives_the_same_arrays_as_files(
    bags: Any, tmp_path: Path, kind: str, is_packed: bool
) -> None:
    samples = edgetree.sample_frames()
    with bags.BagFile(tmp_path, kind) as bag:
        for number, sample in enumerate(samples):
            stamp = bags.START_NS + number * bags.PERIOD_NS
            depth_file = sample.depth_path.read_bytes()
            bag.info(bags.INFO, sample.camera, stamp)
            if is_packed:
                jpeg = sample.image_path.read_bytes()
                bag.packed(f"{bags.COLOUR}/compressed", jpeg, "bgr8; jpeg compressed bgr8", stamp)
                form = "16UC1; compressedDepth png"
                content = bytes(12) + depth_file
                bag.packed(f"{bags.DEPTH}/compressedDepth", content, form, stamp)
            else:
                depth = cv2.imdecode(np.frombuffer(depth_file, np.uint8), cv2.IMREAD_UNCHANGED)
                bag.image(bags.COLOUR, sample.image(), stamp)
                bag.image(bags.DEPTH, depth, stamp, "16UC1")

    frames = list(open_recording(bag.path))

    assert [frame.number for frame in frames] == list(range(len(samples)))
    for frame, sample in zip(frames, samples, strict=True):
        assert frame.image is not None
        assert frame.depth_m is not None
        np.testing.assert_array_equal(frame.image, sample.image())
        np.testing.assert_array_equal(frame.depth_m, sample.depth_m())
        assert frame.camera == sample.camera
        assert frame.depth_fault is None
        assert frame.image.flags.writeable


@pytest.mark.parametrize("kind", KINDS)
def test_one_file_of_a_recording_is_read_too(write_bag: Writer, kind: str) -> None:
    path = write_bag(kind)
    if path.is_dir():
        (path / "metadata.yaml").unlink()
        assert len(list(open_recording(path))) == 5
        (path,) = path.iterdir()
    source = open_recording(path)
    frames = list(source)
    assert not source.is_live
    assert [round(frame.time_s - 1_700_000_000, 3) for frame in frames] == [0, 0.1, 0.2, 0.3, 0.4]


def test_the_bag_that_others_wrote_is_read(shared_path: Callable[[str], Path]) -> None:
    pytest.importorskip("rosbags")
    source = open_recording(shared_path("data/bags/test-button-light.bag"))
    frames = list(source)
    assert len(frames) == 19
    assert {frame.image.shape for frame in frames if frame.image is not None} == {(480, 640, 3)}
    assert {frame.depth_m is None for frame in frames} == {True}
    camera = frames[0].camera
    assert camera is not None
    assert camera.fx == pytest.approx(430.33, abs=0.01)
    # The lit buttons of the lift are warm yellow: the Bayer pattern is read the right way round.
    blue, _, red = frames[-1].image[72, 343]  # type: ignore[index]
    assert int(red) > int(blue) + 30


@pytest.mark.parametrize("name", ["mcap", "sqlite3", "mcap/talker.mcap", "sqlite3/talker.db3"])
def test_a_recording_without_images_is_refused_with_what_it_has(
    shared_path: Callable[[str], Path], name: str
) -> None:
    pytest.importorskip("rosbags")
    with pytest.raises(InputError, match=r"has no images: expected .*/topic \(std_msgs"):
        open_recording(shared_path(f"data/bags/{name}"))


def quarters() -> np.ndarray:
    """(48, 64, 3) uint8 BGR: a picture of four colours."""
    picture = np.zeros((48, 64, 3), np.uint8)
    picture[:24, :32], picture[:24, 32:] = (40, 120, 200), (200, 60, 30)
    picture[24:, :32], picture[24:, 32:] = (90, 180, 60), (150, 150, 150)
    return picture


def mosaic(picture: np.ndarray) -> np.ndarray:
    """What a sensor with red, green in even and green, blue in odd rows reads."""
    read = picture[..., 1].copy()
    read[::2, ::2], read[1::2, 1::2] = picture[::2, ::2, 2], picture[1::2, 1::2, 0]
    return read


def uyvy(picture: np.ndarray) -> np.ndarray:
    """(H, W, 2) uint8 after ITU-R BT.601, in the range of video."""
    blue, green, red = np.moveaxis(picture / 255, -1, 0)
    luma = 16 + 65.481 * red + 128.553 * green + 24.966 * blue
    of_blue = 128 - 37.797 * red - 74.203 * green + 112 * blue
    of_red = 128 + 112 * red - 93.786 * green - 18.214 * blue
    packed = np.stack([of_blue, luma], -1)
    packed[:, 1::2, 0] = of_red[:, ::2]
    return np.round(packed).astype(np.uint8)


ENCODINGS: dict[str, tuple[Callable[[np.ndarray], np.ndarray], int]] = {
    "bgr8": (lambda bgr: bgr, 0),
    "rgb8": (lambda bgr: bgr[..., ::-1], 0),
    "bgra8": (lambda bgr: np.dstack([bgr, bgr[..., 0]]), 0),
    "rgba8": (lambda bgr: np.dstack([bgr[..., ::-1], bgr[..., 0]]), 0),
    "mono8": (lambda bgr: bgr[..., 1], 0),
    "bayer_rggb8": (mosaic, 0),
    "yuv422": (uyvy, 3),
    "yuv422_yuy2": (lambda bgr: uyvy(bgr)[..., ::-1], 3),
}
"""How a picture is encoded, and by how many levels it may come back changed."""


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_encodings_of_colour_become_bgr(bags: Any, tmp_path: Path, encoding: str) -> None:
    encode, most = ENCODINGS[encoding]
    picture = quarters()
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.COLOUR, encode(picture), bags.START_NS, encoding)
    (frame,) = open_recording(bag.path)
    assert frame.image is not None
    grey = np.dstack([picture[..., 1]] * 3)
    off = np.abs(frame.image.astype(int) - (grey if encoding == "mono8" else picture))
    off[22:26], off[:, 30:34] = 0, 0  # where two colours meet, a mosaic mixes them
    assert off.max() <= most


def test_padded_rows_and_big_endian_depth(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    padded = np.pad(frame.image.reshape(48, -1), ((0, 0), (0, 8)))
    swapped = frame.depth.astype(">u2")
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.COLOUR, frame.image, 10**9, step=200, data=padded.ravel())
        data = np.frombuffer(swapped.tobytes(), np.uint8)
        bag.image(bags.DEPTH, frame.depth, 10**9, "16UC1", is_bigendian=1, data=data)
        # Some drivers leave out the padding of the last row.
        short = padded.ravel()[:-8]
        bag.image(bags.COLOUR, frame.image, 2 * 10**9, step=200, data=short)
        bag.image(bags.DEPTH, frame.depth, 2 * 10**9, "16UC1")
    lives = list(open_recording(bag.path))
    assert len(lives) == 2
    for live in lives:
        np.testing.assert_array_equal(live.image, frame.image)
        np.testing.assert_allclose(live.depth_m, frame.depth / 1000, rtol=1e-6)


def test_units_of_depth(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    metres = (frame.depth / 1000).astype(np.float32)
    metres[0, :3] = np.nan, np.inf, -1

    def first(name: str, values: np.ndarray, encoding: str, scale: float | None = None) -> Any:
        with bags.BagFile(tmp_path, name=name) as bag:
            bag.image(bags.DEPTH, values, bags.START_NS, encoding)
        return next(iter(open_recording(bag.path, depth_scale_m=scale)))

    floats = first("floats", metres, "32FC1").depth_m
    assert floats[0, :3].tolist() == [0, 0, 0]
    np.testing.assert_array_equal(floats[1:], metres[1:])
    quarter = first("quarter", frame.depth, "16UC1", 0.00025).depth_m
    np.testing.assert_allclose(quarter, frame.depth / 4000, rtol=1e-6)
    with pytest.raises(InputError, match=r"divide by 1000, or give the unit with --depth-scale 0"):
        first("mm", metres * 1000, "32FC1")
    np.testing.assert_allclose(
        first("mm2", metres * 1000, "32FC1", 0.001).depth_m, floats, rtol=1e-6
    )


def test_quantised_float_depth_is_decoded(bags: Any, tmp_path: Path) -> None:
    scale, offset = 5000.0, 100.0
    depth = np.linspace(1, 8, 64 * 48, dtype=np.float32).reshape(48, 64)
    values = np.rint(scale / depth + offset).astype(np.uint16)
    values[0, 0] = 0
    header = np.array([1], np.int32).tobytes() + np.array([scale, offset], np.float32).tobytes()
    content = header + cv2.imencode(".png", values)[1].tobytes()
    with bags.BagFile(tmp_path) as bag:
        topic = "/cam/depth/image/compressedDepth"
        bag.packed(topic, content, "32FC1; compressedDepth png", bags.START_NS)
    (frame,) = open_recording(bag.path)
    assert frame.depth_m is not None
    assert frame.depth_m[0, 0] == 0
    np.testing.assert_allclose(frame.depth_m.ravel()[1:], depth.ravel()[1:], rtol=0.01)


def test_modality_chooses_the_images(write_bag: Writer) -> None:
    path = write_bag()
    assert {frame.depth_m is None for frame in open_recording(path, modality="rgb")} == {True}
    assert {frame.image is None for frame in open_recording(path, modality="depth")} == {True}


def test_the_camera_of_rectified_images_is_the_projection_matrix(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    camera = calib.PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5, (0.1, -0.05, 0, 0, 0))
    p = [70, 0, 30, 0, 0, 71, 22, 0, 0, 0, 1, 0]
    cameras = {}
    for name in ("image_raw", "image_rect_color"):
        with bags.BagFile(tmp_path, name=name) as bag:
            bag.image(f"/cam/{name}", frame.image, bags.START_NS)
            bag.info("/cam/camera_info", camera, bags.START_NS, p=p)
        cameras[name] = next(iter(open_recording(bag.path))).camera
    assert cameras["image_raw"] == camera
    assert cameras["image_rect_color"] == calib.PinholeCamera(64, 48, 70.0, 71.0, 30.0, 22.0)


def test_looping_goes_on_rising(write_bag: Writer) -> None:
    source = open_recording(write_bag(frames=3), loop=True)
    frames = iter(source)
    seen = [next(frames) for _ in range(8)]
    assert [frame.number for frame in seen] == list(range(8))
    steps = np.diff([frame.time_s for frame in seen])
    np.testing.assert_allclose(steps, 0.1, atol=1e-5)
    np.testing.assert_array_equal(seen[0].image, seen[3].image)
    source.close()
    assert list(frames) == []


def test_close_ends_an_iteration_in_progress(write_bag: Writer) -> None:
    source = open_recording(write_bag())
    frames = iter(source)
    next(frames)
    source.close()
    assert list(frames) == []


def test_what_is_chosen_is_said(write_bag: Writer, caplog: pytest.LogCaptureFixture) -> None:
    path = write_bag()
    with caplog.at_level(logging.INFO, "edgetree.sources"):
        open_recording(path)
    assert "depth is /cam/depth/image_raw" in caplog.text
    assert "16-bit depth is read as millimetres" in caplog.text
