"""Sizes of pictures are known before their pixels are read."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from basetree.errors import InputFileError
from basetree.files.limits import current_limits, set_limits
from basetree.files.picture_size import check_picture_size, picture_size
from calib import read_depth

SUFFIXES = (".png", ".jpg", ".tif", ".bmp", ".webp")


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("channels", [1, 3])
def test_the_header_tells_the_size(suffix: str, channels: int) -> None:
    shape = (21, 34, 3)[: 2 + (channels == 3)]
    data = cv2.imencode(suffix, np.zeros(shape, np.uint8))[1].tobytes()
    assert picture_size(data) == (34, 21)
    for end in range(0, len(data), 3):
        assert picture_size(data[:end]) in (None, (34, 21))


def test_lossless_webp_and_unknown_files_are_known() -> None:
    image = np.zeros((21, 34, 3), np.uint8)
    data = cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, 101])[1].tobytes()
    assert picture_size(data) == (34, 21)
    assert picture_size(b"no picture") is None
    assert picture_size(b"") is None


def png_of(width: int, height: int) -> bytes:
    """A PNG of zeros in about a thousandth of its pixels' bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(bytes(1 + width // 8)) for _ in range(height)) + packer.flush()
    header = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )


@pytest.fixture(autouse=True)
def _default_limits() -> Iterator[None]:
    before = current_limits()
    yield
    set_limits(before)


def test_a_small_file_of_many_pixels_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "large.png"
    path.write_bytes(png_of(30_000, 30_000))
    assert path.stat().st_size < 200_000
    expected = r"large\.png: 30000x30000 px, expected at most 200000000 pixels"
    for read in (check_picture_size, read_depth):
        with pytest.raises(InputFileError, match=expected):
            read(path)
    set_limits(replace(current_limits(), image_pixels=900_000_000))
    check_picture_size(path)


def test_an_array_that_claims_more_than_its_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "depth.npy"
    np.save(path, np.ones((3, 4), np.float32))
    whole = path.read_bytes()
    assert read_depth(path).shape == (3, 4)
    for claim in (b"(70368744177664, 128)", b"(-1, 4)", b"(3, 4, ", b"(3, 'a')"):
        spare = b" " * (len(claim) - len(b"(3, 4)"))
        path.write_bytes(whole.replace(b"(3, 4), }" + spare, claim + b", }"))
        with pytest.raises(InputFileError, match=r"depth\.npy: not a readable \.npy file"):
            read_depth(path)
    np.save(path, np.ones((30, 40), np.float32))
    set_limits(replace(current_limits(), image_pixels=1000))
    with pytest.raises(InputFileError, match="1200 values, expected at most 1000"):
        read_depth(path)
