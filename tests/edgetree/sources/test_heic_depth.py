"""Depth images inside of HEIC pictures: metres are read, other values are named and left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from heic_files import heic_with_depth

from basetree.errors import InputError
from calib import read_depth
from edgetree.sources import open_source

pytest.importorskip("pillow_heif")

HEIGHT, WIDTH = 48, 64
NEAR_M, FAR_M = 0.5, 8.0
PICTURE = np.zeros((2 * HEIGHT, 2 * WIDTH, 3), np.uint8)
PICTURE[:HEIGHT, :WIDTH] = 200
TRUE_M = np.linspace(1.0, 6.0, WIDTH)[None] + np.linspace(0, 1, HEIGHT)[:, None]
SHARES = {
    0: (1 / TRUE_M - 1 / FAR_M) / (1 / NEAR_M - 1 / FAR_M),
    2: (TRUE_M - NEAR_M) / (FAR_M - NEAR_M),
}


def write(path: Path, kind: int | None, near: float = NEAR_M, far: float = FAR_M) -> Path:
    values = np.rint(255 * SHARES.get(kind or 0, SHARES[0])).astype(np.uint8)
    path.write_bytes(heic_with_depth(PICTURE, values, kind, near, far))
    return path


@pytest.mark.parametrize(
    ("kind", "words", "off_m"),
    [
        (0, "of 0.5 to 8 m in 255 steps, 6.6 cm apart at 3 m", 0.2),
        (2, "of 0.5 to 8 m in 255 steps, 2.9 cm apart at 3 m", 0.016),
    ],
)
def test_metres_are_read_in_the_pixels_of_the_picture(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, kind: int, words: str, off_m: float
) -> None:
    path = write(tmp_path / "a.heic", kind)
    (frame,) = open_source(path, path)
    assert frame.image is not None
    assert frame.depth_m is not None
    assert frame.depth_m.shape == frame.image.shape[:2]
    np.testing.assert_allclose(frame.depth_m[::2, ::2], TRUE_M, atol=off_m)
    assert f"depth of {path} is its own image {words}; nothing says how far" in caplog.text
    caplog.clear()
    (frame,) = open_source(path)
    assert frame.depth_m is None
    assert f"holds a depth image {words}: --depth {path} takes it" in caplog.text


def test_a_folder_of_pictures_is_its_own_depth(tmp_path: Path) -> None:
    for name in ("IMG_1.HEIC", "IMG_2.HEIC"):
        write(tmp_path / name, 2)
    frames = list(open_source(tmp_path, tmp_path))
    assert [frame.depth_m is not None for frame in frames] == [True, True]


@pytest.mark.parametrize(
    ("kind", "near", "far", "words"),
    [
        (1, 0.2, 1.7, "of disparities from 0.2 to 1.7, without the distance of the cameras that"),
        (3, 0.2, 1.7, "of disparities from 0.2 to 1.7, without the distance of the cameras that"),
        (None, 0.0, 0.0, "without a word on what its values are"),
        (2, 5.0, 0.5, "without a word on what its values are"),
        (0, 0.5, 1e9, "without a word on what its values are"),
    ],
)
def test_other_values_are_named_and_not_used(
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    kind: int | None,
    near: float,
    far: float,
    words: str,
) -> None:
    path = write(tmp_path / "a.heic", kind, near, far)
    (frame,) = open_source(path)
    assert (frame.image is not None, frame.depth_m) == (True, None)
    assert f"{path} holds a depth image {words}" in caplog.text
    assert "so it is not used: record with" in caplog.text
    with pytest.raises(InputError, match=rf"holds a depth image {words[:20]}.*expected one with"):
        list(open_source(path, path))


def test_a_picture_without_depth_is_told(tmp_path: Path) -> None:
    from PIL import Image
    from pillow_heif import register_heif_opener

    register_heif_opener()
    Image.fromarray(PICTURE).save(tmp_path / "a.heic", "HEIF")
    with pytest.raises(InputError, match="holds no depth image, expected one with metres"):
        read_depth(tmp_path / "a.heic")


@pytest.mark.parametrize("is_turned", [False, True])
@pytest.mark.parametrize("orientation", [5, 6, 7, 8])
def test_depth_of_a_turned_picture_is_in_the_stored_pixels(
    tmp_path: Path, orientation: int, is_turned: bool
) -> None:
    """The depth image is marked as turned, or is not."""
    from PIL import Image

    exif = Image.Exif()
    exif[274] = orientation
    values = np.rint(255 * SHARES[2]).astype(np.uint8)
    path = tmp_path / "a.heic"
    data = heic_with_depth(PICTURE, values, 2, NEAR_M, FAR_M, turns=is_turned, exif=exif.tobytes())
    path.write_bytes(data)
    (frame,) = open_source(path, path)
    assert frame.image is not None
    assert frame.depth_m is not None
    assert frame.image[0, 0].mean() > 190
    np.testing.assert_allclose(frame.depth_m[::2, ::2], TRUE_M, atol=0.05)


def test_depth_of_a_mirrored_picture_is_left(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    from PIL import Image

    exif = Image.Exif()
    exif[274] = 3
    values = np.rint(255 * SHARES[2]).astype(np.uint8)
    data = heic_with_depth(PICTURE, values, 2, NEAR_M, FAR_M, exif=exif.tobytes())
    (tmp_path / "a.heic").write_bytes(data)
    list(open_source(tmp_path / "a.heic"))
    assert "of 0.5 to 8 m, of a picture upside down or mirrored, so it is not used" in caplog.text
