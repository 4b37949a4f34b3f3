"""Ignored boxes move with the image in every augmentation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from augmentations import STILL

from perceptree.data import Sample, augment, flip
from perceptree.data.augment.labels import transform_boxes, transform_ignored
from perceptree.models import ModelSpec, make_spec

WIDTH_PX, HEIGHT_PX = 320, 192
SPEC: ModelSpec = make_spec("edge-n", "rgb", HEIGHT_PX, WIDTH_PX)
BACK, BRIGHT = 40, 200
IGNORED = (200, 40, 230, 150)
MOVES: dict[str, dict[str, Any]] = {
    "flip": {"flip_share": 1.0},
    "shrunk": {"scale": (0.5, 0.8), "flip_share": 0.5},
    "grown": {"scale": (1.2, 1.7), "flip_share": 0.5},
    "crop": {"crop_share": 1.0, "crop": (0.6, 0.9), "flip_share": 0.5},
    "rotation": {"rotation_deg": 15.0, "flip_share": 0.5},
    "perspective": {"perspective": 0.15},
}


def bright_region(masked: bool = True) -> Sample:
    """A bright rectangle that is ignored, and a tree that leaves no bright pixel."""
    image = np.full((HEIGHT_PX, WIDTH_PX, 3), BACK, np.uint8)
    x0, y0, x1, y1 = IGNORED
    image[y0:y1, x0:x1] = BRIGHT
    masks = np.zeros((1, HEIGHT_PX, WIDTH_PX), bool)
    masks[0, 20:170, 70:96] = True
    boxes = np.array([[70.0, 20, 96, 170]])
    ignored = np.array([IGNORED], float)
    return Sample(image, boxes, np.zeros((1, 5, 3)), masks if masked else None, ignored)


@pytest.mark.parametrize("masked", [True, False])
@pytest.mark.parametrize("name", MOVES)
def test_an_ignored_box_bounds_its_pixels(name: str, masked: bool) -> None:
    settings, seen = replace(STILL, **MOVES[name]), 0
    spec = replace(SPEC, pad_value=0)
    for seed in range(20):
        sample = augment(np.random.default_rng(seed), bright_region(masked), spec, settings)
        rows, columns = np.nonzero(sample.image[..., 0] > (BACK + BRIGHT) / 2)
        if not len(rows):
            assert len(sample.ignored) <= 1  # at most a line of less than a pixel is left
            continue
        (box,) = sample.ignored
        pixels = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        assert box == pytest.approx(pixels, abs=1.5)
        seen += 1
    assert seen > 8


def test_flip_mirrors_ignored_boxes() -> None:
    flipped = flip(bright_region())
    assert flipped.ignored.tolist() == [[WIDTH_PX - 230, 40, WIDTH_PX - 200, 150]]
    assert flip(flipped).ignored.tolist() == [list(IGNORED)]


def test_a_small_rest_of_an_ignored_box_stays() -> None:
    # Of a tree 5 % would be too little to keep; as an ignored box it must not become background.
    boxes = np.array([[0.0, 0, 200, 192], [20.0, 0, 60, 192]])
    window = (190, 0, WIDTH_PX, HEIGHT_PX)
    shift = np.array([[1.0, 0, -10], [0, 1, 0], [0, 0, 1]])
    moved = transform_ignored(boxes, shift, window, WIDTH_PX, HEIGHT_PX)
    assert moved.tolist() == [[180, 0, 190, 192]]
    assert transform_boxes(boxes, shift, window, WIDTH_PX, HEIGHT_PX)[1] == []


def test_pasted_trees_leave_the_ignored_boxes_of_the_frame() -> None:
    sample, masks = bright_region(), np.zeros((1, HEIGHT_PX, WIDTH_PX), bool)
    masks[0, 20:170, 145:175] = True  # in the middle, the same when mirrored
    other = replace(sample, masks=masks, ignored=np.array([[1.0, 2, 3, 4]]))
    settings = replace(STILL, copy_paste_share=1.0)
    result = augment(np.random.default_rng(0), sample, SPEC, settings, lambda: other)
    assert result.boxes[:, 0].tolist() == [70, 145]
    assert result.ignored.tolist() == [list(IGNORED)]
