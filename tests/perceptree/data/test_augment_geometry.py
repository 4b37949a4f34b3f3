"""Geometric augmentation: painted posts and dots move with their labels."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from augmentations import STILL

from perceptree.data import Sample, augment, flip
from perceptree.models import ModelSpec, make_spec

WIDTH_PX, HEIGHT_PX = 320, 192
SPEC: ModelSpec = make_spec("edge-n", "rgb", HEIGHT_PX, WIDTH_PX)
BACK, POST = 40, 200
POSTS = ((70, 20, 96, 170), (200, 40, 216, 150))  # x0, y0, x1, y1
MOVES = {
    "flip": {"flip_share": 1.0},
    "shrunk": {"scale": (0.5, 0.8), "flip_share": 0.5},
    "grown": {"scale": (1.2, 1.7), "flip_share": 0.5},
    "crop": {"crop_share": 1.0, "crop": (0.6, 1.0), "flip_share": 0.5},
    "small crop": {"crop_share": 1.0, "crop": (0.7, 0.6)},
    "rotation": {"rotation_deg": 15.0, "flip_share": 0.5},
    "shear": {"shear_deg": 15.0},
    "perspective": {"perspective": 0.15},
    "all": {
        "flip_share": 0.5,
        "scale": (0.7, 1.5),
        "crop_share": 0.5,
        "crop": (0.6, 0.9),
        "rotation_deg": 12.0,
        "shear_deg": 10.0,
        "perspective": 0.12,
        "perspective_share": 0.5,
    },
}


def keypoints_of(x0: int, y0: int, x1: int, y1: int) -> list[list[float]]:
    middle = (x0 + x1) / 2
    return [
        [middle, y1 - 10, 2],
        [x0, y1 - 20, 2],
        [x1, y1 - 20, 2],
        [middle, y1 - 50, 1],
        [0, 0, 0],
    ]


def posts() -> Sample:
    image = np.full((HEIGHT_PX, WIDTH_PX, 3), BACK, np.uint8)
    masks = np.zeros((len(POSTS), HEIGHT_PX, WIDTH_PX), bool)
    for mask, (x0, y0, x1, y1) in zip(masks, POSTS, strict=True):
        mask[y0:y1, x0:x1] = True
        image[y0:y1, x0:x1] = POST
    keypoints = np.array([keypoints_of(*post) for post in POSTS])
    return Sample(image, np.array(POSTS, float), keypoints, masks)


def dot(x: float, y: float) -> np.ndarray:
    """An image with one blurred dot at a continuous position."""
    rows, columns = np.mgrid[0:HEIGHT_PX, 0:WIDTH_PX] + 0.5
    spot = 250 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 2.5**2))
    return np.repeat(spot.astype(np.uint8)[..., None], 3, 2)


def centre(image: np.ndarray) -> np.ndarray:
    """Return the position x, y of the dot."""
    weight = image[..., 0].astype(float)
    rows, columns = np.mgrid[0:HEIGHT_PX, 0:WIDTH_PX] + 0.5
    return np.array([(columns * weight).sum(), (rows * weight).sum()]) / weight.sum()


def is_within(inner: np.ndarray, outer: np.ndarray) -> bool:
    """Return whether all of ``inner`` except its border pixels is inside ``outer``."""
    core = cv2.erode(inner.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1)
    return not (core.astype(bool) & ~outer).any()


@pytest.mark.parametrize("name", MOVES)
def test_masks_and_boxes_are_those_of_the_posts(name: str) -> None:
    settings, seen = replace(STILL, **MOVES[name]), 0
    for seed in range(25):
        sample = augment(np.random.default_rng(seed), posts(), SPEC, settings)
        assert sample.image.shape == (HEIGHT_PX, WIDTH_PX, 3)
        assert sample.masks is not None
        post, labelled = sample.image[..., 0] > (BACK + POST) / 2, sample.masks.any(0)
        assert is_within(labelled, post)
        if len(sample.masks) == len(POSTS):
            assert is_within(post, labelled)
        for box, mask in zip(sample.boxes, sample.masks, strict=True):
            columns, rows = np.nonzero(mask.any(0))[0], np.nonzero(mask.any(1))[0]
            assert box.tolist() == [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
        seen += len(sample.masks)
    assert seen > 25


@pytest.mark.parametrize("name", MOVES)
def test_keypoints_move_with_the_image(name: str) -> None:
    settings, gaps = replace(STILL, **MOVES[name]), []
    spec, both = replace(SPEC, pad_value=0), posts()
    alone = Sample(
        np.full_like(both.image, 255), both.boxes[:1], both.keypoints[:1], both.masks[:1]
    )
    for seed in range(8):
        white = augment(np.random.default_rng(seed), alone, spec, settings)
        if not len(white.boxes):
            continue
        left, right = white.keypoints[0, 1], white.keypoints[0, 2]
        assert left[0] < right[0] or not (left[2] and right[2])
        inner = cv2.erode(white.image[..., 0], np.ones((31, 31), np.uint8), borderValue=0)
        found = white.keypoints[0][white.keypoints[0, :, 2] > 0, :2]
        shown = cv2.dilate(white.image[..., 0], np.ones((3, 3), np.uint8))
        assert all(shown[int(y), int(x)] for x, y in found)  # none is in the padding
        for x, y, _ in keypoints_of(*POSTS[0])[:4]:
            sample = replace(alone, image=dot(x, y))
            moved = augment(np.random.default_rng(seed), sample, spec, settings).image
            if (
                moved.max() < 200
                or not inner[np.unravel_index(moved[..., 0].argmax(), inner.shape)]
            ):
                continue  # the dot is outside, or may be cut off
            offsets = found - centre(moved)
            gaps.append(offsets[np.hypot(*offsets.T).argmin()])
    assert len(gaps) >= 4
    # An offset of half a pixel would be visible in each of them, and in their mean.
    assert np.abs(gaps).max() < 0.35
    assert np.abs(np.mean(gaps, axis=0)).max() < 0.15


def test_a_flip_is_exact_and_equals_the_flip_function() -> None:
    moved = augment(np.random.default_rng(0), posts(), SPEC, replace(STILL, flip_share=1.0))
    for name, value in vars(flip(posts())).items():
        assert np.array_equal(getattr(moved, name), value)


def test_a_crop_shows_nothing_outside_its_window() -> None:
    settings = replace(STILL, crop_share=1.0, crop=(0.5, 1.0))
    columns = np.arange(WIDTH_PX) // 2 + 1  # value of each pair of columns
    image = np.repeat(np.tile(columns.astype(np.uint8), (HEIGHT_PX, 1))[..., None], 3, 2)
    starts = set()
    for seed in range(20):
        rng, sample = np.random.default_rng(seed), replace(posts(), image=image)
        row = augment(rng, sample, replace(SPEC, pad_value=255), settings).image[0, :, 0]
        # Half of the width, at its own scale, with the rest padded.
        values = row[row != 255].astype(int)
        assert len(values) == WIDTH_PX // 2
        start = 2 * int(values[0]) - 2 + int(values[0] != values[1])
        assert (values == columns[start : start + WIDTH_PX // 2]).all()
        starts.add(start)
    assert len(starts) > 5


def test_a_crop_of_the_same_aspect_ratio_fills_the_image() -> None:
    settings = replace(STILL, crop_share=1.0, crop=(0.5, 0.5))
    for seed in range(5):
        moved = augment(np.random.default_rng(seed), posts(), replace(SPEC, pad_value=1), settings)
        assert (moved.image > 1).all()


@pytest.mark.parametrize("name", MOVES)
def test_without_masks_boxes_contain_the_masks(name: str) -> None:
    settings = replace(STILL, **MOVES[name])
    straight = not {"rotation_deg", "shear_deg", "perspective"} & set(MOVES[name])
    for seed in range(25):
        masked = augment(np.random.default_rng(seed), posts(), SPEC, settings)
        bare = augment(np.random.default_rng(seed), replace(posts(), masks=None), SPEC, settings)
        assert bare.masks is None
        assert (bare.image == masked.image).all()
        assert len(bare.boxes) == len(bare.keypoints)
        if straight and len(bare.boxes) == len(masked.boxes):
            assert np.abs(bare.boxes - masked.boxes).max(initial=0) <= 1
        for box in masked.boxes:
            grown = np.abs(bare.boxes - box).max(1, initial=0)
            holding = (bare.boxes[:, :2] <= box[:2] + 1) & (bare.boxes[:, 2:] >= box[2:] - 1)
            assert holding.all(1).any() or grown.size < len(masked.boxes)


def test_a_box_that_is_cropped_away_is_removed() -> None:
    kept = set()
    settings = replace(STILL, crop_share=1.0, crop=(0.3, 1.0))
    for seed in range(30):
        bare = augment(np.random.default_rng(seed), replace(posts(), masks=None), SPEC, settings)
        kept.add(len(bare.boxes))
        sides = bare.boxes[:, 2:] - bare.boxes[:, :2]
        assert (sides[:, 0] * sides[:, 1] >= 0.25 * 16 * 110).all()
    assert kept == {0, 1}


def test_many_and_overlapping_masks_move_independently() -> None:
    rng = np.random.default_rng(0)
    masks = np.zeros((19, HEIGHT_PX, WIDTH_PX), bool)
    for mask in masks:
        x, y = rng.integers(0, WIDTH_PX - 60), rng.integers(0, HEIGHT_PX - 60)
        mask[y : y + 60, x : x + 60] = True
    boxes = np.zeros((19, 4))
    sample = Sample(posts().image, boxes, np.zeros((19, 5, 3)), masks)
    settings = replace(STILL, scale=(0.8, 0.8), rotation_deg=10.0)
    together = augment(np.random.default_rng(5), sample, SPEC, settings)
    assert together.masks is not None
    assert len(together.masks) == 19
    for row in range(19):
        one = Sample(sample.image, boxes[:1], sample.keypoints[:1], masks[row : row + 1])
        alone = augment(np.random.default_rng(5), one, SPEC, settings)
        assert alone.masks is not None
        assert (together.masks[row] == alone.masks[0]).all()
        assert (together.boxes[row] == alone.boxes[0]).all()


def test_a_frame_without_trees_is_supported() -> None:
    empty = Sample(
        posts().image,
        np.zeros((0, 4)),
        np.zeros((0, 5, 3)),
        np.zeros((0, HEIGHT_PX, WIDTH_PX), bool),
    )
    for name in MOVES:
        for sample in (empty, replace(empty, masks=None)):
            moved = augment(np.random.default_rng(1), sample, SPEC, replace(STILL, **MOVES[name]))
            assert moved.boxes.shape == (0, 4)
            assert moved.keypoints.shape == (0, 5, 3)
