"""Pasting masks, run lengths and polygons."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from calib import encode_rle, mask_polygons, paste_mask


def _reference_paste(
    probability: NDArray[np.float32], box: NDArray[np.float32], width: int, height: int
) -> NDArray[np.float64]:
    """The sampling rule, one pixel at a time."""
    padded = np.pad(probability.astype(np.float64), 1)
    cells = probability.shape[0]
    values = np.zeros((height, width))
    for row in range(height):
        for column in range(width):
            u = (column + 0.5 - box[0]) / (box[2] - box[0]) * cells - 0.5
            v = (row + 0.5 - box[1]) / (box[3] - box[1]) * cells - 0.5
            if -1 < u < cells and -1 < v < cells:
                c, r = int(np.floor(u)), int(np.floor(v))
                patch = padded[r + 1 : r + 3, c + 1 : c + 3]
                a, b = u - c, v - r
                values[row, column] = np.array([1 - b, b]) @ patch @ np.array([1 - a, a])
    return values


SEEDS = st.integers(0, 2**32 - 1)
# Corners on, between and beyond the pixels; boxes from a fraction of a pixel to all of the image.
CORNERS = st.integers(-20, 30) | st.floats(-20, 30)
SIDES = st.integers(1, 60) | st.floats(0.3, 60)


@given(CORNERS, CORNERS, SIDES, SIDES, st.sampled_from([1, 2, 7, 28]), SEEDS)
def test_pasting_follows_the_sampling_rule(
    x0: float, y0: float, width: float, height: float, cells: int, seed: int
) -> None:
    probability = np.random.default_rng(seed).uniform(0, 1, (cells, cells)).astype(np.float32)
    box_px = np.array([x0, y0, x0 + width, y0 + height], np.float32)
    expected = _reference_paste(probability, box_px, 30, 24)
    pasted = paste_mask(probability, box_px, 30, 24)
    sure = np.abs(expected - 0.5) > 1e-4
    np.testing.assert_array_equal(pasted[sure], expected[sure] >= 0.5)


def test_a_full_mask_fills_exactly_its_box() -> None:
    box_px = np.array([10.0, 4.0, 38.0, 60.0], dtype=np.float32)
    expected = np.zeros((70, 50), dtype=bool)
    expected[4:60, 10:38] = True
    pasted = paste_mask(np.ones((28, 28), np.float32), box_px, 50, 70)
    np.testing.assert_array_equal(pasted, expected)


@pytest.mark.parametrize("box", [(-30.0, 0.0, -10.0, 20.0), (5.0, 5.0, 5.0, 9.0), (99, 0, 120, 9)])
def test_a_box_without_pixels_gives_an_empty_mask(box: tuple[float, ...]) -> None:
    pasted = paste_mask(np.ones((28, 28), np.float32), np.array(box, np.float32), 40, 30)
    assert pasted.shape == (30, 40)
    assert not pasted.any()


def test_pycocotools_reads_the_rle() -> None:
    coco = pytest.importorskip("pycocotools.mask")
    rng = np.random.default_rng(2)
    blob = np.zeros((720, 1280), dtype=bool)
    blob[100:700, 400:470] = True
    speckle = rng.uniform(size=(61, 47)) < 0.4
    for mask in (blob, speckle, ~speckle, np.zeros((5, 4), bool), np.ones((5, 4), bool)):
        rle = encode_rle(mask)
        np.testing.assert_array_equal(coco.decode(rle).astype(bool), mask)
        reference = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
        assert rle["counts"] == reference["counts"].decode()


def test_rle_of_a_known_mask() -> None:
    mask = np.array([[0, 1, 1], [0, 1, 0]], dtype=bool)
    # Down the columns: two zeros, three ones, one zero.
    assert encode_rle(mask) == {"size": [2, 3], "counts": "231"}


@st.composite
def masks(draw: st.DrawFn) -> NDArray[np.bool_]:
    """Speckles of any density, some with whole columns empty or full."""
    rng = np.random.default_rng(draw(SEEDS))
    shape = draw(st.tuples(st.integers(1, 90), st.integers(1, 90)))
    mask = rng.uniform(size=shape) < draw(st.floats(0, 1))
    for value in (False, True):
        mask[:, rng.uniform(size=shape[1]) < draw(st.sampled_from([0, 0, 0.3, 0.9]))] = value
    return mask


def _decode(counts: str, height: int, width: int) -> NDArray[np.bool_]:
    """COCO's compressed runs, read one character at a time as its C code does."""
    runs: list[int] = []
    value = shift = 0
    for character in counts.encode():
        digit = character - 48
        value |= (digit & 0x1F) << shift
        shift += 5
        if not digit & 0x20:
            value -= (1 << shift) if digit & 0x10 else 0
            runs.append(value + (runs[-2] if len(runs) > 2 else 0))
            value = shift = 0
    flat = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
    return flat.reshape(width, height).T


@given(masks())
def test_rle_decodes_to_the_mask(mask: NDArray[np.bool_]) -> None:
    rle = encode_rle(mask)
    assert rle["size"] == list(mask.shape)
    np.testing.assert_array_equal(_decode(rle["counts"], *mask.shape), mask)


@given(masks())
def test_rle_of_any_mask_is_that_of_the_coco_tools(mask: NDArray[np.bool_]) -> None:
    coco = pytest.importorskip("pycocotools.mask")
    reference = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
    assert encode_rle(mask)["counts"] == reference["counts"].decode()


def leaning_trunk() -> NDArray[np.bool_]:
    """A trunk about 40 px wide, cut in two by a branch in front of it."""
    y, x = np.mgrid[:360, :640]
    stem = (np.abs(x - 300 - 0.1 * y) < 20) & (y > 40) & (y < 340)
    return np.asarray(stem & ~((y > 150) & (y < 156)))


def test_polygons_reproduce_the_mask() -> None:
    coco = pytest.importorskip("pycocotools.mask")
    stem = leaning_trunk()
    polygons = mask_polygons(stem)
    assert len(polygons) == 2
    assert sum(map(len, polygons)) < 2 * 60
    drawn = coco.decode(coco.merge(coco.frPyObjects(polygons, *stem.shape))).astype(bool)
    assert (drawn & stem).sum() > 0.97 * (drawn | stem).sum()


def test_polygons_run_along_the_edges_of_pixels() -> None:
    mask = np.zeros((30, 40), bool)
    mask[4:20, 10:13] = True
    corners = np.array(mask_polygons(mask)[0]).reshape(-1, 2)
    assert sorted(map(tuple, corners.tolist())) == [(10, 4), (10, 20), (13, 4), (13, 20)]


def test_small_parts_are_left_out_and_empty_masks_have_no_polygons() -> None:
    stem = leaning_trunk()
    stem[3, 3] = True
    assert len(mask_polygons(stem)) == 2
    assert mask_polygons(np.zeros((5, 5), bool)) == []


def test_a_hole_is_filled() -> None:
    ring = np.zeros((40, 40), np.uint8)
    cv2.circle(ring, (20, 20), 15, 1, 4)
    polygons = mask_polygons(ring.astype(bool))
    assert len(polygons) == 1


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 9), (9, 1), (30, 2)])
def test_thin_masks_keep_their_outline(height: int, width: int) -> None:
    mask = np.zeros((40, 20), bool)
    mask[3 : 3 + height, 4 : 4 + width] = True
    (corners,) = mask_polygons(mask)
    x, y = np.array(corners).reshape(-1, 2).T
    assert (x.min(), x.max(), y.min(), y.max()) == (4, 4 + width, 3, 3 + height)
