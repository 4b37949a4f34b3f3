"""Pictures and videos that state how they are to be turned, with a camera and without."""

import logging
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from picture_files import exif, jpeg, jpeg_segment

import calib
from basetree.errors import InputError
from edgetree.frames.images import read_masks
from edgetree.frames.rig import Rig
from edgetree.sources import open_source

CAMERA = calib.PinholeCamera(40, 24, 50.0, 50.0, 19.5, 11.5)


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """A picture of 40x24 px, blue at its stored upper left, to be turned to the right."""
    image = np.zeros((24, 40, 3), np.uint8)
    image[:12, :20] = (255, 0, 0)
    for number in range(2):
        data = jpeg(image, jpeg_segment(0xE1, b"Exif\0\0" + exif(6)))
        (tmp_path / f"p{number}.jpg").write_bytes(data)
    calib.write_depth(tmp_path / "depth.png", np.full((24, 40), 2.0, np.float32))
    return tmp_path / "p0.jpg"


def _blue_corner(image: np.ndarray) -> tuple[int, ...]:
    rows, columns = np.nonzero(image[..., 0] > 128)
    return (*image.shape[:2], int(rows.mean() > image.shape[0] / 2), int(columns.mean() > 12))


def test_pixels_are_the_cameras_where_depth_or_a_camera_is_given(
    picture: Path, caplog: pytest.LogCaptureFixture
) -> None:
    depth = picture.with_name("depth.png")
    for source in (
        open_source(picture, depth),
        open_source(picture, rig=Rig(camera=CAMERA)),
        open_source(picture, depth, rig=Rig(camera=CAMERA)),
        open_source(picture, upright=False),
    ):
        caplog.clear()
        (frame,) = source
        assert frame.image is not None
        assert _blue_corner(frame.image) == (24, 40, 0, 0)
        expected = "EXIF orientation 6, to be turned by 90 degrees to the right: the pixels are"
        assert f"p0.jpg: {expected} taken as stored" in caplog.text


def test_pictures_alone_are_turned_upright_and_told_once(
    picture: Path, caplog: pytest.LogCaptureFixture
) -> None:
    picture.with_name("depth.png").unlink()
    frames = list(open_source(picture.parent))
    assert len(frames) == 2
    for frame in frames:
        assert frame.image is not None
        assert _blue_corner(frame.image) == (40, 24, 0, 1)
    assert caplog.text.count("the pixels are turned upright") == 1


def test_sizes_that_differ_name_the_orientation(picture: Path) -> None:
    other = picture.with_name("other.png")
    calib.write_depth(other, np.full((40, 24), 2.0, np.float32))
    stated = r"as stored \(EXIF orientation 6, to be turned by 90 degrees to the right\)"
    with pytest.raises(InputError, match=rf"expected 40x24 px, like image .*p0\.jpg {stated}"):
        list(open_source(picture, other))
    mask = picture.with_name("mask.bmp")
    cv2.imwrite(str(mask), np.ones((24, 40), np.uint8))
    with pytest.raises(InputError, match=r"mask\.bmp is 40x24 px: expected 24x40 px"):
        read_masks(mask, (24, 40))


def _turned_video(path: Path) -> Path:
    """A video of 64x48 px whose matrix says to turn it by 90 degrees."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, (64, 48))
    for _ in range(3):
        writer.write(np.full((48, 64, 3), 90, np.uint8))
    writer.release()
    data = bytearray(path.read_bytes())
    at = data.find(b"tkhd") + 4 + 40
    one = 0x10000
    assert struct.unpack_from(">9i", data, at) == (one, 0, 0, 0, one, 0, 0, 0, 0x40000000)
    struct.pack_into(">9i", data, at, 0, one, 0, -one, 0, 0, 48 * one, 0, 0x40000000)
    path.write_bytes(data)
    return path


def test_videos_are_turned_without_a_camera_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    path = _turned_video(tmp_path / "turned.mp4")
    shapes = {frame.image.shape for frame in open_source(path) if frame.image is not None}
    assert shapes == {(64, 48, 3)}
    assert "turned.mp4: to be turned by 90 degrees: the frames are turned upright" in caplog.text
    camera = calib.PinholeCamera(64, 48, 50.0, 50.0, 31.5, 23.5)
    stored = open_source(path, rig=Rig(camera=camera))
    assert {frame.image.shape for frame in stored if frame.image is not None} == {(48, 64, 3)}
    assert "the frames are taken as stored, those of the camera" in caplog.text
