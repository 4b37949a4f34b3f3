"""Mask images: one tree for each value, and errors for other images."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from basetree.errors import InputError
from edgetree.frames.images import read_masks


def _mask(dtype: type[np.integer] = np.uint8) -> NDArray[np.integer]:
    values = np.zeros((48, 64), dtype)
    values[10:40, 5:9] = 200
    values[0:48, 60:64] = 7
    return values


def _write(path: Path, values: NDArray[np.integer]) -> Path:
    assert cv2.imwrite(str(path), values)
    return path


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_each_value_is_a_tree(tmp_path: Path, dtype: type[np.integer]) -> None:
    found = read_masks(_write(tmp_path / "m.png", _mask(dtype)), (64, 48))
    assert found.numbers == (7, 200)
    np.testing.assert_array_equal(found.trees.boxes_px, [[60, 0, 64, 48], [5, 10, 9, 40]])
    assert found.trees.keypoints_px is None
    assert (found.trees.scores == 1).all()
    for index, number in enumerate(found.numbers):
        np.testing.assert_array_equal(found.mask(index), _mask() == number)


BAD = {
    "another size": ("m.png", _mask()[:24, :32], r"m\.png is 32x24 px: expected 64x48 px"),
    "colours": ("m.png", np.ones((48, 64, 3), np.uint8), r"m\.png has 3 channels of uint8"),
    "no tree": (
        "m.png",
        np.zeros((48, 64), np.uint8),
        "contains 0 values other than 0: expected one per",
    ),
    "a photograph": (
        "m.png",
        np.arange(48 * 64, dtype=np.uint16).reshape(48, 64),
        "contains 3071 values other than 0: expected one per tree, 1 to 100",
    ),
    "a lossy file": ("m.jpg", _mask(), r"m\.jpg is JPEG, not in a lossless format"),
}


@pytest.mark.parametrize("case", BAD)
def test_files_that_are_not_masks_are_rejected(tmp_path: Path, case: str) -> None:
    name, values, message = BAD[case]
    with pytest.raises(InputError, match=message):
        read_masks(_write(tmp_path / name, values), (64, 48))


def test_the_content_says_whether_a_mask_is_lossless(tmp_path: Path) -> None:
    (tmp_path / "m.png").write_bytes(_write(tmp_path / "a.jpg", _mask()).read_bytes())
    with pytest.raises(InputError, match=r"m\.png is JPEG, not in a lossless format"):
        read_masks(tmp_path / "m.png", (64, 48))
    (tmp_path / "m.mask").write_bytes(_write(tmp_path / "a.png", _mask()).read_bytes())
    assert read_masks(tmp_path / "m.mask", (64, 48)).numbers == (7, 200)


def test_a_mask_in_a_tiff_is_lossless_unless_it_is_packed_as_jpeg(tmp_path: Path) -> None:
    for compression in (1, 5, 8):
        path = tmp_path / f"{compression}.tif"
        cv2.imwrite(str(path), _mask(), [cv2.IMWRITE_TIFF_COMPRESSION, compression])
        assert read_masks(path, (64, 48)).numbers == (7, 200)
    cv2.imwrite(str(tmp_path / "m.tif"), _mask(), [cv2.IMWRITE_TIFF_COMPRESSION, 7])
    with pytest.raises(InputError, match=r"m\.tif is TIFF with JPEG, not in a lossless format"):
        read_masks(tmp_path / "m.tif", (64, 48))


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.png cannot be read \(No such file"):
        read_masks(tmp_path / "none.png", (64, 48))
    path = _write(tmp_path / "m.png", _mask())
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"m\.png cannot be read \(\d+ bytes\)"):
        read_masks(path, (64, 48))


def test_small_parts_beside_a_stem_are_left_out_and_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    values = _mask()
    values[:] = np.where(values == 7, 0, values)
    stem = values > 0
    stem[20:24] = False  # a twig hides a piece of it
    values[:] = np.where(stem, 9, 0)
    values[30:32, 40:43] = 9
    found = read_masks(_write(tmp_path / "m.png", values), (64, 48))
    np.testing.assert_array_equal(found.mask(0), stem)
    told = "m.png: 1 small part of value 9 beside the stem, 6 of 110 px, is left out"
    assert told in caplog.text


def test_trees_of_one_value_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    values = np.where(_mask() > 0, 255, 0).astype(np.uint8)
    found = read_masks(_write(tmp_path / "m.png", values), (64, 48))
    np.testing.assert_array_equal(found.mask(0), values > 0)
    assert "value 255 has 2 large parts side by side: if they are different trees" in caplog.text
