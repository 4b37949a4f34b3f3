"""Pictures are read as stored; the orientation that they state is applied if asked for."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from picture_files import exif, jpeg, jpeg_segment, png, png_chunk, tiff_of, webp_with_exif

from basetree.files.reading import decode_picture, orientation_note
from calib import read_depth

TURNED = range(2, 9)


def _image() -> np.ndarray:
    image = np.zeros((24, 40, 3), np.uint8)
    image[:8, :8], image[:8, 32:], image[16:, :8] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    return image


def _png(image: np.ndarray, orientation: int) -> bytes:
    plain: bytes = cv2.imencode(".png", image)[1].tobytes()
    assert plain[:33] == png(size=(40, 24), colour=2)[:33]
    return plain[:33] + png_chunk(b"eXIf", exif(orientation, "<")) + plain[33:]


WRITERS = {
    "JPEG": lambda image, turn: jpeg(image, jpeg_segment(0xE1, b"Exif\0\0" + exif(turn))),
    "JPEG behind another segment": lambda image, turn: jpeg(
        image, jpeg_segment(0xE1, b"http://ns"), jpeg_segment(0xE1, b"Exif\0\0" + exif(turn, "<"))
    ),
    "PNG": _png,
    "WebP": lambda image, turn: webp_with_exif(image, exif(turn)),
    "TIFF": lambda image, turn: tiff_of(image, tag_274=turn),
    "BigTIFF": lambda image, turn: tiff_of(image, ">", big=True, tag_274=turn),
}


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("orientation", TURNED)
def test_stored_pixels_are_read_and_can_be_turned(form: str, orientation: int) -> None:
    image = _image()
    data = WRITERS[form](image, orientation)
    for flags in (cv2.IMREAD_COLOR, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH, cv2.IMREAD_UNCHANGED):
        picture = decode_picture(data, flags)
        assert picture is not None
        assert picture.orientation == orientation
        stored = decode_picture(WRITERS[form](image, 1), flags)
        assert stored is not None
        np.testing.assert_array_equal(picture.pixels, stored.pixels)
    shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(picture.upright(), shown)


@pytest.mark.parametrize("orientation", [0, 9, 65535])
def test_orientations_that_do_not_exist_turn_nothing(orientation: int) -> None:
    for write in WRITERS.values():
        picture = decode_picture(write(_image(), orientation))
        assert picture is not None
        assert picture.orientation == 1
        assert picture.upright() is picture.pixels


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_depth_in_a_turned_tiff_is_read_as_stored(tmp_path: Path, dtype: type) -> None:
    values = np.arange(1, 13, dtype=dtype).reshape(3, 4)
    path = tmp_path / "depth.tif"
    form = {"tag_339": 3} if dtype == np.float32 else {}
    path.write_bytes(tiff_of(values, tag_274=6, **form))
    np.testing.assert_array_equal(read_depth(path, scale=1.0), values)


def test_a_message_about_a_size_names_the_orientation(tmp_path: Path) -> None:
    (tmp_path / "turned.jpg").write_bytes(WRITERS["JPEG"](_image(), 6))
    (tmp_path / "upright.jpg").write_bytes(WRITERS["JPEG"](_image(), 1))
    expected = " as stored (EXIF orientation 6, to be turned by 90 degrees to the right)"
    assert orientation_note(tmp_path / "turned.jpg") == expected
    assert orientation_note(tmp_path / "upright.jpg") == ""
    assert orientation_note(tmp_path / "missing.jpg") == ""
