"""Files whose names are not UTF-8 are read and written like others."""

import os
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import calib
from basetree.errors import InputFileError
from basetree.files.names import is_utf8, printable
from basetree.files.reading import is_image_file, open_video, read_image
from basetree.files.writing import write_image, write_text

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="names are UTF-8 on this system")

LATIN = os.fsdecode(b"caf\xe9")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / LATIN).mkdir()
    return tmp_path / LATIN


def test_depth_maps_and_pictures_are_read_and_written(folder: Path) -> None:
    depth_m = np.full((4, 6), 1.25, np.float32)
    calib.write_depth(folder / f"{LATIN}.png", depth_m)
    assert np.array_equal(calib.read_depth(folder / f"{LATIN}.png"), depth_m)
    np.save(folder / f"{LATIN}.npy", depth_m)
    assert np.array_equal(calib.read_depth(folder / f"{LATIN}.npy"), depth_m)
    (folder / f"{LATIN}.tif").write_bytes(cv2.imencode(".tif", depth_m)[1].tobytes())
    assert np.array_equal(calib.read_depth(folder / f"{LATIN}.tif"), depth_m)
    colour = np.full((4, 6, 3), (10, 20, 30), np.uint8)
    write_image(folder / "colour.png", colour)
    assert np.array_equal(read_image(folder / "colour.png"), colour)


def test_cameras_keep_their_values(folder: Path) -> None:
    camera = calib.PinholeCamera(640, 360, 400.0, 400.0, 319.5, 179.5)
    calib.save_camera(folder / f"{LATIN}.json", camera)
    assert calib.load_camera(folder / f"{LATIN}.json") == camera


def test_what_is_no_image_is_told(folder: Path) -> None:
    (folder / "text.png").write_text("no image")
    assert read_image(folder / "text.png") is None
    assert read_image(folder / "missing.png") is None
    assert read_image(folder) is None
    with pytest.raises(InputFileError, match="not a readable image"):
        calib.read_depth(folder / "text.png")


def test_videos_need_names_in_utf8(folder: Path) -> None:
    with pytest.raises(InputFileError, match="its name is not UTF-8"):
        open_video(folder / "video.avi")
    assert not is_image_file(folder / "picture")


def test_names_are_spelled_out_in_texts(tmp_path: Path) -> None:
    assert is_utf8("café")
    assert not is_utf8(Path(LATIN))
    assert printable("café") == "café"
    assert printable(LATIN) == r"caf\udce9"
    write_text(tmp_path / "names.txt", f"café {LATIN}\n")
    assert (tmp_path / "names.txt").read_text("utf-8") == "café caf\\udce9\n"


@pytest.mark.parametrize("name", ["depth", "depth.npy"])
def test_depth_under_a_name_that_is_no_pictures_is_refused(folder: Path, name: str) -> None:
    with pytest.raises(InputFileError, match=r"expected pixels .* and a name such as"):
        calib.write_depth(folder / name, np.ones((4, 6), np.float32))
    assert not (folder / name).exists()
