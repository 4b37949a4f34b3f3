"""Stems followed in the picture: numbers, and how many different ones there are."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from edgetree import TreeDetections
from edgetree.live.tracking import PictureTracker
from edgetree.measure import Estimate, Failure

WIDTH, HEIGHT = 640, 360
STEMS_PX = (310, 450, 590, 730, 860, 1020)


def panorama() -> np.ndarray:
    rng, wide = np.random.default_rng(0), np.zeros((HEIGHT, 1800, 3), np.float32)
    for size_px in (4, 12, 36, 90):  # as in a forest, there is something at every scale
        noise = rng.uniform(0, 64, (HEIGHT // size_px, 1800 // size_px, 3)).astype(np.float32)
        wide += cv2.resize(noise, (1800, HEIGHT), interpolation=cv2.INTER_CUBIC)
    return wide.clip(0, 255).astype(np.uint8)


def detections(stems_px: list[float], width_px: float = 30) -> TreeDetections:
    boxes = [[x, 40, x + width_px, 300] for x in stems_px]
    count = len(boxes)
    return TreeDetections(
        np.array(boxes, np.float32).reshape(-1, 4),
        np.full(count, 0.9, np.float32),
        None,
        None,
        WIDTH,
        HEIGHT,
    )


def panned(tracker: PictureTracker, step_px: int, hidden: range = range(0)) -> dict[int, set[int]]:
    """Pan over the stems; returns the numbers that each of them got."""
    wide, numbers = panorama(), {x: set() for x in STEMS_PX}
    for frame, left in enumerate(range(0, 900, step_px)):
        there = [x for x in STEMS_PX if left - 10 < x < left + WIDTH and frame not in hidden]
        trees = detections([x - left for x in there])
        tracks = tracker.update(wide[:, left : left + WIDTH], trees, frame / 10)
        for x, number in zip(there, tracks, strict=True):
            numbers[x] |= {number} - {None}
    return numbers


@pytest.mark.parametrize("step_px", [10, 60, 100])
def test_stems_keep_their_numbers_while_the_camera_turns(step_px: int) -> None:
    tracker = PictureTracker()
    numbers = panned(tracker, step_px)
    assert all(len(each) == 1 for each in numbers.values())
    assert tracker.count == len(STEMS_PX) == len(set.union(*numbers.values()))
    count = tracker.different()
    assert isinstance(count, Estimate)
    assert (count.value, 1 < count.std < 3) == (6, True)


def test_stems_that_are_hidden_for_some_frames_are_the_same_afterwards() -> None:
    tracker = PictureTracker()
    numbers = panned(tracker, 10, hidden=range(20, 30))
    assert all(len(each) == 1 for each in numbers.values())
    assert tracker.count == len(STEMS_PX)


def test_what_one_frame_alone_shows_is_not_counted() -> None:
    tracker = PictureTracker()
    for frame in range(12):
        stems_px = [100.0] + ([400.0] if frame in (3, 9) else [])
        tracks = tracker.update(None, detections(stems_px), frame / 10)
    assert tracks == (1,)
    assert tracker.count == 1


def test_stems_of_frames_that_have_nothing_in_common_are_not_counted() -> None:
    tracker = PictureTracker()
    for frame in range(6):
        tracker.update(None, detections([100.0 + 170 * (frame % 3)]), 10.0 * frame)
    count = tracker.different()
    assert isinstance(count, Failure)
    assert "far apart" in count.reason


@pytest.mark.parametrize("scale", [0.0, 1e-9, 1e9, np.nan])
def test_a_motion_that_no_camera_makes_is_none(
    monkeypatch: pytest.MonkeyPatch, scale: float
) -> None:
    def estimate(before: np.ndarray, *_: object, **options: object) -> tuple[object, object]:
        return np.array([[scale, 0, 0], [0, scale, 0]]), np.ones(len(before), np.uint8)

    monkeypatch.setattr(cv2, "estimateAffinePartial2D", estimate)
    assert panned(PictureTracker(), 20)[STEMS_PX[0]]
