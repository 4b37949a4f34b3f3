"""A picture is decoded only if its header says how large it is, and the file holds what it says."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from picture_files import (
    jpeg,
    jpeg_segment,
    png,
    png_chunk,
    png_of_zeros,
    tiff,
    tiff_of,
    with_jpeg_size,
)

from basetree.errors import InputFileError
from basetree.files.headers.exif import read_focal_px
from basetree.files.limits import current_limits, set_limits
from basetree.files.picture_size import picture_size
from basetree.files.reading import decode_image, is_image_file, read_image
from calib import read_depth
from edgetree.frames.images import read_masks

GREY = (np.arange(21 * 34) % 251).astype(np.uint8).reshape(21, 34)
COLOUR = np.dstack([GREY, GREY // 2, GREY // 3])
DEPTH = GREY.astype(np.uint16) * 100
SIDE = 32_000


@pytest.fixture(autouse=True)
def _default_limits() -> Iterator[None]:
    before = current_limits()
    yield
    set_limits(before)


def _encoded(suffix: str, image: NDArray[np.generic], *options: int) -> bytes:
    data: bytes = cv2.imencode(suffix, image, options)[1].tobytes()
    return data


READ = {
    "16-bit PNG": _encoded(".png", DEPTH),
    "palette PNG behind a text": png(
        png_chunk(b"tEXt", b"a\0b"),
        png_chunk(b"PLTE", bytes(range(6))),
        png_chunk(b"IDAT", zlib.compress(bytes(21 * 6))),
        size=(34, 21),
        bits=1,
        colour=3,
    ),
    "bytes behind the end of a PNG": _encoded(".png", GREY) + bytes(100),
    "progressive JPEG": _encoded(".jpg", COLOUR, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "grey JPEG": _encoded(".jpg", GREY),
    "late frame header": jpeg(COLOUR, *[jpeg_segment(0xE5, bytes(65_000))] * 5),
    "fill bytes before a marker": jpeg(COLOUR, b"\xff\xff\xff"),
    "bytes between segments": jpeg(COLOUR, jpeg_segment(0xFE, b"comment"), b"\0\x01\xff\0"),
    "BigTIFF": tiff_of(DEPTH, big=True),
    "large-endian BigTIFF": tiff_of(COLOUR, ">", big=True),
    "late TIFF directory": tiff_of(DEPTH, gap=400_000),
    "deflated TIFF": _encoded(".tif", COLOUR, cv2.IMWRITE_TIFF_COMPRESSION, 8),
    "float TIFF": _encoded(".tif", DEPTH.astype(np.float32)),
    "JPEG in TIFF": _encoded(".tif", COLOUR, cv2.IMWRITE_TIFF_COMPRESSION, 7),
    "BMP": _encoded(".bmp", COLOUR),
    "grey BMP": _encoded(".bmp", GREY),
    "lossless WebP": _encoded(".webp", COLOUR, cv2.IMWRITE_WEBP_QUALITY, 101),
    "GIF": _encoded(".gif", COLOUR),
    "PGM": _encoded(".pgm", GREY),
    "16-bit PGM": _encoded(".pgm", DEPTH),
    "PGM with a comment": b"P5\n# by a camera\n34 21 # size\n255\n" + GREY.tobytes(),
    "PGM as text": b"P2 34 21 255 " + b" ".join(b"%d" % value for value in GREY.flat) + b"\n",
    "PBM": b"P4 34 21\n" + bytes(5 * 21),
    "PPM": _encoded(".ppm", COLOUR),
    "PFM": _encoded(".pfm", DEPTH.astype(np.float32)),
}


@pytest.mark.parametrize("case", READ)
def test_pictures_of_every_format_are_read_whole(case: str, tmp_path: Path) -> None:
    data = READ[case]
    assert picture_size(data) == (34, 21)
    expected = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(decode_image(data, cv2.IMREAD_UNCHANGED), expected)
    path = tmp_path / "picture.png"  # the content says what it is, not the name
    path.write_bytes(data)
    assert is_image_file(path)
    image = read_image(path, cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.shape[:2] == (21, 34)


def _strips(count: int, width: int = SIDE, height: int = SIDE, **more: int) -> bytes:
    """A TIFF of so many strips, all at the same place."""
    tags = {256: width, 257: height, 258: 16, 277: 1, 278: more.get("rows", 256)}
    entries = {tag: (4, [value]) for tag, value in tags.items()}
    return tiff(
        entries | {273: (4, [16] * count), 279: (4, [more.get("bytes", 100)] * count)},
        bytes(100),
        big=bool(more.get("big", 0)),
    )


TOO_LARGE = {
    "PGM without pixels": b"P5\n32000 32000\n65535\n" + bytes(1000),
    "PPM as text": b"P3 32000 32000 255 " + b"1 " * 1000,
    "PFM without pixels": b"Pf\n32000 32000\n-1.0\n" + bytes(1000),
    "PNG of other chunks": png(png_chunk(b"IDAT", b"", 2**31), size=(SIDE, SIDE)),
    "PNG": png_of_zeros(SIDE, SIDE),
    "late JPEG frame": with_jpeg_size(
        jpeg(COLOUR, *[jpeg_segment(0xE5, bytes(65_000))] * 5), SIDE, SIDE
    ),
    "TIFF": _strips(125),
    "BigTIFF": _strips(125, big=1),
    "GIF": b"GIF89a" + struct.pack("<HH", SIDE, SIDE) + bytes(20),
    "packed BMP": _encoded(".bmp", GREY)[:18]
    + struct.pack("<iiHHI", SIDE, -SIDE, 1, 8, 1)
    + bytes(500),
    "WebP": b"RIFF\x20\0\0\0WEBPVP8X\x0a\0\0\0\0\0\0\0"
    + (SIDE - 1).to_bytes(3, "little") * 2
    + bytes(20),
}


@pytest.mark.parametrize("case", TOO_LARGE)
def test_pictures_of_too_many_pixels_are_refused_unread(case: str, tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(TOO_LARGE[case])
    expected = r"picture\.png: 32000x32000 px, expected at most 200000000 pixels"
    for read in (read_image, read_depth, lambda path: read_masks(path, (4, 3))):
        with pytest.raises(InputFileError, match=expected):
            read(path)
    with pytest.raises(InputFileError, match="the picture: 32000x32000 px"):
        decode_image(path.read_bytes())


@pytest.mark.parametrize("bits", [8, 16])
def test_bytes_of_deep_pixels_count_too(bits: int) -> None:
    set_limits(replace(current_limits(), image_pixels=10_000))
    data = png_of_zeros(90, 80, bits, colour=6)
    assert decode_image(data) is not None
    expected = "90x80 px of PNG take 0.0576 MB" if bits == 8 else "90x80 px of PNG take 0.115 MB"
    with pytest.raises(InputFileError, match=expected + " to read, expected at most 0.05 MB"):
        decode_image(data, cv2.IMREAD_UNCHANGED)


def test_metres_of_depth_count_too(tmp_path: Path) -> None:
    set_limits(replace(current_limits(), image_pixels=10_000))
    (tmp_path / "depth.png").write_bytes(png_of_zeros(90, 110, 16))
    np.save(tmp_path / "depth.npy", np.zeros((90, 110), np.uint16))
    for name in ("depth.png", "depth.npy"):
        with pytest.raises(InputFileError, match=r"9900 values take 0\.0594 MB with their metres"):
            read_depth(tmp_path / name)
    np.save(tmp_path / "depth.npy", np.zeros((70, 110), np.uint16))
    assert read_depth(tmp_path / "depth.npy").shape == (70, 110)


STATED = {
    "PNG data of 4 GB": png(png_chunk(b"IDAT", b"\0", 0xFFFFFFF0)),
    "PNG text of 2 GB": png(png_chunk(b"tEXt", b"\0", 0x7FFFFFF0)),
    "PNG text of 2 GB at the end": _encoded(".png", GREY)[:-12]
    + struct.pack(">I4s", 2**31, b"tEXt"),
    "PNG without end": _encoded(".png", GREY)[:-12],
    "PNG of another first chunk": b"\x89PNG\r\n\x1a\n" + png_chunk(b"tEXt", bytes(40)),
    "TIFF of fewer strips": _strips(3),
    "TIFF of strips beyond its end": _strips(125, bytes=2**31),
    "TIFF of a huge strip": _strips(1, 8, 6, rows=2**31, bytes=2**31),
    "TIFF of huge tiles": tiff(
        {256: (4, [8]), 257: (4, [6]), 322: (4, [2**20]), 323: (4, [2**20])}, bytes(99)
    ),
    "TIFF of values beyond its end": tiff_of(GREY).replace(
        struct.pack("<HHI", 278, 4, 1), struct.pack("<HHI", 278, 4, 2**29)
    ),
    "TIFF with a tag twice": tiff_of(GREY).replace(
        struct.pack("<HHI", 277, 3, 1), struct.pack("<HHI", 256, 3, 1)
    ),
    "TIFF of 65535 entries": b"II*\0\x08\0\0\0\xff\xff" + bytes(500),
    "BigTIFF directory at its end": b"II+\0\x08\0\0\0" + struct.pack("<Q", 2**63) + bytes(50),
    "PGM": b"P5\n320 320\n65535\n" + bytes(1000),
    "PGM as text": b"P2\n320 320\n65535\n" + b"1 " * 1000,
    "PPM": b"P6\n180 180\n255\n" + bytes(1000),
    "PBM": b"P4 320 320\n" + bytes(1000),
    "PFM": b"Pf\n320 320\n-1.0\n" + bytes(1000),
    "PGM of many digits": b"P5 " + b"9" * 400 + b" 1 255\n" + bytes(10),
    "BMP": _encoded(".bmp", GREY)[:18] + struct.pack("<iiHH", 320, 320, 1, 8) + bytes(2000),
    "JPEG without a frame": b"\xff\xd8" + jpeg_segment(0xE0, bytes(60)) + b"\xff\xd9",
    "JPEG of 300 scans": jpeg(COLOUR, options=(cv2.IMWRITE_JPEG_PROGRESSIVE, 1))[:-2]
    + b"\xff\xda" * 300,
}


@pytest.mark.parametrize("case", STATED)
def test_what_a_header_states_must_be_there(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was given to a decoder"))
    assert picture_size(STATED[case]) is None
    assert decode_image(STATED[case]) is None
    path = tmp_path / "picture.png"
    path.write_bytes(STATED[case])
    with pytest.raises(InputFileError, match=r"picture\.png: not a readable image"):
        read_depth(path)


OTHER = {
    "Radiance HDR": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16000 +X 16000\n" + bytes(100),
    "JPEG 2000": bytes.fromhex("0000000c6a5020200d0a870a") + bytes(100),
    "AVIF": b"\0\0\0\x20ftypavif" + bytes(100),
    "OpenEXR": bytes.fromhex("762f3101") + bytes(100),
    "Sun raster": _encoded(".ras", COLOUR),
    "PAM": b"P7\nWIDTH 34\nHEIGHT 21\n" + bytes(100),
}


@pytest.mark.parametrize("case", OTHER)
def test_other_formats_are_named(case: str, tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(OTHER[case])
    with pytest.raises(
        InputFileError, match=rf"picture\.png: a {case} picture, expected JPEG, PNG"
    ):
        read_image(path)
    assert is_image_file(path)


def test_previews_and_other_compressions_of_tiff_are_named() -> None:
    with pytest.raises(InputFileError, match="a camera raw file or one that begins with a preview"):
        decode_image(tiff_of(COLOUR, tag_254=1))
    with pytest.raises(InputFileError, match="a TIFF of compression 34712, expected none, LZW"):
        decode_image(tiff_of(COLOUR, tag_259=34712))


def _exif_with(order: str, **numbers: tuple[int, int]) -> bytes:
    """EXIF metadata with entries in the directory of the photograph's data."""
    tags = {"equivalent": (41989, 3), "focal": (37386, 5), "plane": (41486, 5), "unit": (41488, 3)}
    tags["width"] = (40962, 4)
    mark = b"II" if order == "<" else b"MM"
    start, entries, extra = 8 + 2 + 12 + 4, b"", b""
    place = start + 2 + 12 * len(numbers) + 4
    for name, (upper, lower) in numbers.items():
        tag, kind = tags[name]
        head = struct.pack(f"{order}HHI", tag, kind, 1)
        if kind == 5:
            entries += head + struct.pack(f"{order}I", place + len(extra))
            extra += struct.pack(f"{order}II", upper, lower)
        elif kind == 3:
            entries += head + struct.pack(f"{order}HH", upper, 0)
        else:
            entries += head + struct.pack(f"{order}I", upper)
    first = struct.pack(f"{order}HHHII", 1, 34665, 4, 1, start) + bytes(4)
    header = mark + struct.pack(f"{order}HI", 42, 8)
    return header + first + struct.pack(f"{order}H", len(numbers)) + entries + bytes(4) + extra


@pytest.mark.parametrize("order", ["<", ">"])
def test_exif_states_the_focal_length(order: str) -> None:
    phone = _exif_with(order, equivalent=(26, 1))
    assert read_focal_px(phone, 4032, 3024) == pytest.approx(26 / 43.267 * 5040, rel=1e-3)
    # 50 mm on a sensor of 36 mm with 6000 px, stored at half its size.
    camera = {"focal": (50, 1), "plane": (60000, 36), "unit": (3, 1), "width": (6000, 1)}
    expected = 50 * 6000 / 36 / 2
    assert read_focal_px(_exif_with(order, **camera), 3000, 2000) == pytest.approx(expected)


@pytest.mark.parametrize(
    "exif",
    [
        b"",
        b"II",
        b"II*\0\xff\xff\xff\xff",
        _exif_with("<", equivalent=(0, 1)),
        _exif_with("<", equivalent=(60000, 1)),
        _exif_with("<", focal=(50, 0), plane=(1, 0), width=(0, 1)),
        _exif_with("<", equivalent=(26, 1))[:30],
    ],
)
def test_exif_without_a_focal_length_gives_none(exif: bytes) -> None:
    assert read_focal_px(exif, 4000, 3000) is None
