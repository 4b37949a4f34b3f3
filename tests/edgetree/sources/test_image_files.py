"""Frames from images, folders and videos, and errors for other sources."""

from __future__ import annotations

import struct
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import calib
from basetree.errors import InputError, InputFileError
from basetree.files.headers import heif
from basetree.files.headers.exif import turned_upright
from basetree.files.limits import current_limits, set_limits
from edgetree.frames.images import read_image
from edgetree.sources import open_source
from edgetree.sources.live import VENDORS
from edgetree.sources.source import readable


def _write(path: Path, width: int = 64, height: int = 48, level: int = 90) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.full((height, width, 3), level, np.uint8))
    return path


def _write_depth(path: Path, width: int = 64, height: int = 48) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    calib.write_depth(path, np.full((height, width), 2.5, np.float32))
    return path


def test_an_image_is_one_frame(tmp_path: Path) -> None:
    source = open_source(_write(tmp_path / "a.png"), _write_depth(tmp_path / "d.png"))
    (frame,) = source
    assert source.count == 1
    assert frame.name == "a"
    assert frame.image is not None
    assert frame.image.shape == (48, 64, 3)
    assert frame.depth_m is not None
    assert frame.depth_m[0, 0] == pytest.approx(2.5)


def test_a_folder_gives_its_images_sorted_by_name(tmp_path: Path) -> None:
    for name in ("b.jpg", "a.png", "c.JPG", ".hidden.png"):
        _write(tmp_path / "images" / name)
    (tmp_path / "images" / "notes.txt").write_text("x")
    for stem in "abc":
        _write_depth(tmp_path / "depth" / f"{stem}.png")
    source = open_source(tmp_path / "images", tmp_path / "depth")
    frames = list(source)
    assert [frame.name for frame in frames] == ["a", "b", "c"]
    assert all(frame.depth_m is not None for frame in frames)
    assert source.count == 3


def test_depth_may_be_in_another_kind_of_file(tmp_path: Path) -> None:
    _write(tmp_path / "images" / "a.jpg")
    (tmp_path / "depth").mkdir()
    np.save(tmp_path / "depth" / "a.npy", np.full((48, 64), 1.5, np.float32))
    (frame,) = open_source(tmp_path / "images", tmp_path / "depth")
    assert frame.depth_m is not None
    assert frame.depth_m[0, 0] == pytest.approx(1.5)


def test_unusable_depth_has_a_reason(tmp_path: Path) -> None:
    image, depth = _write(tmp_path / "a.png"), tmp_path / "d.png"
    calib.write_depth(depth, np.zeros((48, 64), np.float32))
    (frame,) = open_source(image, depth)
    assert frame.depth_fault is not None
    assert "d.png: no pixel has depth" in frame.depth_fault
    sloping_m = np.linspace(2, 3, 48 * 64, dtype=np.float32).reshape(48, 64)
    calib.write_depth(depth, sloping_m)
    (frame,) = open_source(image, depth)
    assert frame.depth_fault is None


def test_images_of_the_same_stem_get_different_names(tmp_path: Path) -> None:
    for name in ("a.png", "a.jpg", "b.jpg"):
        _write(tmp_path / name)
    assert [frame.name for frame in open_source(tmp_path)] == ["a.jpg", "a.png", "b"]


def test_depth_images_without_colour_are_read(tmp_path: Path) -> None:
    (frame,) = open_source(_write_depth(tmp_path / "d.png"), depth_only=True)
    assert frame.image is None
    assert frame.depth_m is not None


def test_a_video_gives_numbered_frames(tmp_path: Path) -> None:
    path = tmp_path / "drive.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for level in (0, 100, 200):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    source = open_source(path)
    frames = list(source)
    assert source.count == 3
    assert [frame.name for frame in frames] == ["drive_000000", "drive_000001", "drive_000002"]
    assert [frame.time_s for frame in frames] == [0.0, 0.1, 0.2]
    levels = [int(frame.image.mean()) for frame in frames if frame.image is not None]
    assert levels == pytest.approx([0, 100, 200], abs=3)
    with pytest.raises(InputError, match="is not an image: expected an image or a folder"):
        open_source(path, depth=tmp_path)


@pytest.mark.parametrize("text", [*VENDORS, "0", "/dev/video99", "rtsp://camera:554/1"])
def test_a_camera_is_said_to_be_for_live(text: str) -> None:
    with pytest.raises(InputError, match=f"a stream is for `edgetree live {text}`$"):
        open_source(Path(text))


def test_a_missing_source_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.png does not exist: expected an image, a folder"):
        open_source(tmp_path / "none.png")
    with pytest.raises(InputError, match=r"none\.png cannot be read \(No such file"):
        read_image(tmp_path / "none.png")
    with pytest.raises(InputError, match=r"source rtsp://camera:554/1 does not exist"):
        open_source(Path("rtsp://camera:554/1"))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".mp4", ".txt"])
def test_a_file_that_is_neither_image_nor_video_is_named(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(b"neither image nor video" * 20)
    with pytest.raises(InputError, match=rf"broken\{suffix} cannot be read.*: expected"):
        list(open_source(path))


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_truncated_image_is_rejected(tmp_path: Path, suffix: str) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)
    path = tmp_path / f"half{suffix}"
    cv2.imwrite(str(path), noise)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"half.* cannot be read \(\d+ bytes\)"):
        read_image(path)


def test_an_image_of_too_many_pixels_is_not_decoded(tmp_path: Path) -> None:
    path = tmp_path / "huge.png"
    header = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">II", 30_000, 30_000)
    path.write_bytes(header + b"\x08\2\0\0\0" + bytes(100) + b"IEND\xaeB`\x82")
    with pytest.raises(InputFileError, match=r"huge\.png: 30000x30000 px, expected at most"):
        read_image(path)


def test_an_empty_file_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "empty.png").touch()
    with pytest.raises(InputError, match=r"empty\.png cannot be read \(0 bytes\)"):
        list(open_source(tmp_path / "empty.png"))


def test_a_folder_without_images_is_named(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(InputError, match=r"has no images: expected \.jpg, "):
        open_source(tmp_path)


def test_a_folder_goes_on_after_a_broken_image(tmp_path: Path) -> None:
    for name in ("a.png", "c.png"):
        _write(tmp_path / name)
    (tmp_path / "b.png").write_text("no image")
    source = open_source(tmp_path)
    assert source.count == 3
    frames = iter(source)
    assert next(frames).name == "a"
    with pytest.raises(InputError, match=r"b\.png cannot be read .*: expected"):
        next(frames)
    assert [frame.name for frame in frames] == ["c"]
    errors: list[Exception] = []
    assert [frame.name for frame in readable(source, errors.append)] == ["a", "c"]
    assert len(errors) == 1


def test_depth_of_another_size_is_named(tmp_path: Path) -> None:
    image, depth = _write(tmp_path / "a.png"), _write_depth(tmp_path / "d.png", 32, 24)
    message = r"d\.png is 32x24 px: expected 64x48 px, like image .*a\.png"
    with pytest.raises(InputError, match=message):
        list(open_source(image, depth))


def test_missing_depth_is_named_in_advance(tmp_path: Path) -> None:
    _write(tmp_path / "images" / "a.png")
    (tmp_path / "depth").mkdir()
    with pytest.raises(InputError, match=r"depth.a\.png does not exist, nor with .*: expected"):
        open_source(tmp_path / "images", tmp_path / "depth")
    with pytest.raises(InputError, match="is not a folder: expected one"):
        open_source(tmp_path / "images", tmp_path / "images" / "a.png")
    with pytest.raises(InputError, match="is not a file: expected the depth image"):
        open_source(tmp_path / "images" / "a.png", tmp_path / "depth")


def test_a_depth_image_is_not_read_as_colour(tmp_path: Path) -> None:
    path = _write_depth(tmp_path / "d.png")
    with pytest.raises(InputError, match=r"d\.png is uint16: expected 8-bit colour; a depth image"):
        read_image(path)
    (frame,) = open_source(path)
    assert frame.image is None


def test_grey_images_become_colour(tmp_path: Path) -> None:
    grey: NDArray[np.uint8] = np.full((8, 9), 77, np.uint8)
    cv2.imwrite(str(tmp_path / "g.png"), grey)
    np.testing.assert_array_equal(read_image(tmp_path / "g.png"), np.full((8, 9, 3), 77))


def test_heic_pictures_that_cannot_be_read_are_named_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    monkeypatch.setattr(heif, "is_readable", lambda: False)
    for name in ("IMG_1.HEIC", "IMG_2.heic"):
        (tmp_path / name).write_bytes(b"\0\0\0\x20ftypheic" + bytes(100))
    expected = r"2 HEIC pictures such as IMG_1\.HEIC, which need pillow-heif: pip install "
    with pytest.raises(InputError, match=rf"has no images but {expected}"):
        open_source(tmp_path)
    _write(tmp_path / "a.png")
    assert len(list(open_source(tmp_path))) == 1
    assert "2 HEIC pictures such as" in caplog.text
    with pytest.raises(InputFileError, match="a HEIF picture, which needs pillow-heif"):
        read_image(tmp_path / "IMG_1.HEIC")


@pytest.mark.parametrize("orientation", range(1, 9))
def test_heic_pictures_are_read_as_stored_with_their_orientation(
    tmp_path: Path, orientation: int
) -> None:
    stored = _write_heic(tmp_path / "IMG_1.HEIC", orientation)
    (frame,) = open_source(tmp_path, upright=False)
    assert frame.name == "IMG_1"
    assert frame.image is not None
    assert np.abs(frame.image.astype(int) - stored).mean() < 4
    (frame,) = open_source(tmp_path)
    assert frame.image is not None
    upright = turned_upright(stored, orientation)
    assert frame.image.shape == upright.shape
    assert np.abs(frame.image.astype(int) - upright).mean() < 4
    assert frame.exif_focal_px == pytest.approx(26 / 43.27 * 80, rel=0.01)


def test_a_heic_picture_that_is_cut_off_is_left_out(tmp_path: Path) -> None:
    _write_heic(tmp_path / "a.heic", 1)
    data = (tmp_path / "a.heic").read_bytes()
    (tmp_path / "b.heic").write_bytes(data[: len(data) // 2])
    errors: list[Exception] = []
    frames = list(readable(open_source(tmp_path), errors.append))
    assert [frame.name for frame in frames] == ["a"]
    assert "b.heic cannot be read" in str(errors[0])


def test_a_large_heic_picture_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    _write_heic(tmp_path / "a.heic", 1)
    before = set_limits(replace(current_limits(), image_pixels=1000))
    try:
        with pytest.raises(InputFileError, match="64x48 px, expected at most 1000 pixels"):
            read_image(tmp_path / "a.heic")
    finally:
        set_limits(before)


def _write_heic(path: Path, orientation: int) -> NDArray[np.uint8]:
    """Write a picture of four colours with EXIF data; returns its stored pixels, BGR."""
    pillow_heif = pytest.importorskip("pillow_heif")
    from PIL import Image

    pillow_heif.register_heif_opener()
    stored = np.zeros((48, 64, 3), np.uint8)
    stored[:24, :32], stored[24:, :32], stored[:24, 32:] = 200, (120, 0, 0), (0, 60, 0)
    exif = Image.Exif()
    exif[274] = orientation
    exif.get_ifd(34665)[41989] = 26
    Image.fromarray(stored[..., ::-1]).save(path, "HEIF", exif=exif.tobytes(), quality=95)
    return stored


def test_pictures_for_a_depth_model_are_named(tmp_path: Path) -> None:
    _write(tmp_path / "a.jpg")
    with pytest.raises(
        InputError, match=r"no depth images but 1 picture such as a\.jpg: .*--depth"
    ):
        open_source(tmp_path, depth_only=True)


def test_a_picture_as_depth_may_be_swapped(tmp_path: Path) -> None:
    picture = _write(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"uint8: expected .*are picture and depth swapped\?"):
        list(open_source(picture, _write(tmp_path / "b.png")))
