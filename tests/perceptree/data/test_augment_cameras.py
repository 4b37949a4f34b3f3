"""Depth cameras of other kinds, drawn on exact depth."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from augmentations import STILL

from perceptree.data import Sample, augment
from perceptree.data.augment.cameras import filled_from_left, filled_with_farther, held, lidar
from perceptree.data.augment.views import without_ground
from perceptree.models import ModelSpec, make_spec
from perceptree.settings.cameras import CAMERA_KINDS

WIDTH_PX, HEIGHT_PX = 320, 192
SPEC: ModelSpec = make_spec("edge-n", "depth", HEIGHT_PX, WIDTH_PX)
LEVEL_M = 20 / 255
NONE = 255
POST_M, WALL_M = 4.0, 10.0
POST = (slice(20, 170), slice(150, 180))
CAMERA = replace(
    STILL,
    camera_width_px=(WIDTH_PX, WIDTH_PX),
    camera_range_m=(20, 20),
    camera_zoom=(1, 1),
    portrait_share=0,
    above_share=0,
    bare_share=0,
    ghost_share=0,
)


def scene() -> Sample:
    """Exact depth of a post before a wall, and a second post that is farther away."""
    image = np.full((HEIGHT_PX, WIDTH_PX), round(WALL_M / LEVEL_M), np.uint8)
    masks = np.zeros((2, HEIGHT_PX, WIDTH_PX), bool)
    masks[0][POST], masks[1, 40:150, 40:52] = True, True
    image[masks[0]], image[masks[1]] = round(POST_M / LEVEL_M), round(8 / LEVEL_M)
    boxes = np.array([[150.0, 20, 180, 170], [40, 40, 52, 150]])
    return Sample(image, boxes, np.zeros((2, 5, 3)), masks, exact=True)


def drawn(seed: int, *kinds: str, **settings: Any) -> Sample:
    changed = replace(CAMERA, camera_kinds=dict.fromkeys(kinds or CAMERA_KINDS, 1.0), **settings)
    return augment(np.random.default_rng(seed), scene(), SPEC, changed)


def landscape(sample: Sample) -> np.ndarray:
    """The part of the image that has readings."""
    rows, columns = np.nonzero(sample.image != NONE)
    return sample.image[: rows.max() + 1, : columns.max() + 1]


@pytest.mark.parametrize("kind", CAMERA_KINDS)
def test_each_kind_depends_on_the_seed_alone(kind: str) -> None:
    first, again, other = drawn(1, kind), drawn(1, kind), drawn(2, kind)
    assert (first.image == again.image).all()
    assert first.image.shape == other.image.shape
    assert (first.image != other.image).any()


@pytest.mark.parametrize("kind", CAMERA_KINDS)
def test_posts_are_read_where_their_masks_are(kind: str) -> None:
    for seed in range(8):
        sample = drawn(seed, kind, camera_zoom=(0.7, 4), portrait_share=0.5)
        assert sample.masks is not None
        for mask in sample.masks:
            inner = sample.image[mask]
            inner = inner[inner != NONE] * LEVEL_M
            if len(inner) > 50:  # the nearer post may be nearer still, as a zoom is
                assert np.median(inner) < 9


def test_measured_depth_is_augmented_as_before() -> None:
    plain = replace(scene(), exact=False)
    found = augment(np.random.default_rng(0), plain, SPEC, STILL)
    assert (found.image == plain.image).all()


def test_exact_depth_is_only_moved() -> None:
    sample = drawn(3, "exact")
    assert sample.masks is not None
    found = sample.image[sample.masks[0]] * LEVEL_M
    assert np.mean(np.abs(found - POST_M) < LEVEL_M) > 0.95


def test_matching_widens_what_is_near() -> None:
    def width(matching_px: int) -> float:
        widths = []
        for seed in range(12):
            sample = drawn(seed, "stereo", camera_matching_px=matching_px)
            assert sample.masks is not None
            near = np.abs(sample.image * LEVEL_M - POST_M) < 0.5
            widths.append(near.sum() / max(sample.masks[0].sum(), 1))
        return float(np.mean(widths))

    assert width(4) > width(0) + 0.05


def test_what_is_beyond_the_range_is_not_read_and_its_trees_are_removed() -> None:
    for seed in range(6):
        sample = drawn(seed, "exact", "stereo", "tof", camera_range_m=(6, 6))
        assert len(sample.boxes) <= 1
        read = sample.image[sample.image != NONE]
        assert np.percentile(read, 90) * LEVEL_M <= 6.5


def test_the_nearest_tree_is_always_within_reach() -> None:
    assert all(len(drawn(seed, "exact", camera_range_m=(0.5, 0.5)).boxes) for seed in range(6))


def test_trees_between_a_lidars_beams_are_kept() -> None:
    shares, kept = [], []
    for seed in range(20):
        sample = drawn(seed, "lidar")
        kept.append(len(sample.boxes))
        assert sample.masks is not None
        shares += [float((sample.image[mask] != NONE).mean()) for mask in sample.masks]
    assert min(kept) >= 1
    assert min(shares) < 0.1


def test_lidar_lines_keep_their_distance() -> None:
    depth_m = np.full((64, 64), 5.0, np.float32)
    share = np.mean([np.isfinite(lidar(rng_of(n), depth_m, CAMERA)).mean() for n in range(20)])
    assert 0.02 < share < 0.9


def rng_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_a_small_sensor_gives_coarse_readings() -> None:
    """With the nearest reading, runs along a row are as long as the sensor's pixels are large."""

    def runs(width_px: float) -> float:
        samples = [drawn(seed, "tof", camera_width_px=(width_px, width_px)) for seed in range(6)]
        return float(np.mean([np.count_nonzero(np.diff(landscape(each))) for each in samples]))

    assert runs(80) < 0.7 * runs(WIDTH_PX)


def test_portrait_pictures_lie_at_the_left() -> None:
    for seed in range(6):
        sample = drawn(seed, "exact", portrait_share=1, flip_share=0.5)
        assert (sample.image[:, round(0.8 * HEIGHT_PX) + 1 :] == NONE).all()
        assert (sample.boxes[:, 2] <= 0.8 * HEIGHT_PX + 1).all()


def test_a_zoom_enlarges_trees_and_may_bring_them_nearer() -> None:
    widths, nearest = [], []
    for seed in range(10):
        sample = drawn(seed, "exact", camera_zoom=(2, 2))
        widths += [x1 - x0 for x0, _, x1, _ in sample.boxes]
        nearest.append(sample.image[sample.image != NONE].min() * LEVEL_M)
    assert 50 <= max(widths) <= 62
    assert min(nearest) < 0.75 * POST_M
    assert max(nearest) > 0.9 * POST_M


def test_the_ground_is_removed_and_trees_stay() -> None:
    rows = np.arange(HEIGHT_PX, dtype=np.float32)[:, None]
    with np.errstate(divide="ignore"):
        ground = np.where(rows > 60, 1.8 * 160 / np.maximum(rows - 60, 1), np.inf)
    depth_m = np.tile(ground, (1, WIDTH_PX)).astype(np.float32)
    tree = np.zeros(depth_m.shape, bool)
    tree[10:130, 100:120] = True
    log = (slice(120, 140), slice(200, 260))
    depth_m[tree], depth_m[log] = POST_M, 2.5
    bare = without_ground(depth_m, tree)
    assert (bare[tree] == POST_M).all()
    assert np.isfinite(bare[log]).all()
    others = ~tree
    others[log] = False
    assert np.isinf(bare[others]).mean() > 0.98


def test_ground_that_cannot_be_seen_is_left() -> None:
    depth_m = np.full((40, 40), np.inf, np.float32)
    assert (without_ground(depth_m, np.zeros((40, 40), bool)) == depth_m).all()


def test_holes_show_an_earlier_picture() -> None:
    depth_m = np.full((60, 400), 5.0, np.float32)
    depth_m[20:40, 100:103] = np.inf
    found = [np.isfinite(held(rng_of(n), depth_m)[20:40, 100:103]).mean() for n in range(10)]
    assert np.mean(found) > 0.5


def test_holes_are_filled_from_the_left_or_with_the_farther_side() -> None:
    row = np.array([[np.inf, 2, np.inf, np.inf, 6, np.inf]], np.float32)
    assert filled_from_left(row).tolist() == [[np.inf, 2, 2, 2, 6, 6]]
    assert filled_with_farther(row, 1).tolist() == [[2, 2, 2, 6, 6, 6]]


def test_a_frame_without_readings_stays_so() -> None:
    empty = replace(scene(), image=np.full((HEIGHT_PX, WIDTH_PX), NONE, np.uint8))
    found = augment(np.random.default_rng(0), empty, SPEC, CAMERA)
    assert (found.image == NONE).all()
