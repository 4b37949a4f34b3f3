"""Matching and pixel errors, compared with a separate computation."""

from pathlib import Path

import numpy as np
import pytest

from perceptree.data import FrameRecord, TreeRecord
from perceptree.evaluation.errors_px import Spread, density, histogram, measure_errors
from perceptree.evaluation.matching import Pair, match_trees
from perceptree.evaluation.predictions import FramePrediction


def tree(left: float, points: np.ndarray | None = None, crowd: bool = False) -> TreeRecord:
    keypoints = np.zeros((5, 3)) if points is None else points
    return TreeRecord(1, np.array([left, 0, left + 10, 40.0]), keypoints, None, crowd, {})


def frame(*trees: TreeRecord) -> FrameRecord:
    return FrameRecord(7, Path("7.png"), None, None, 200, 50, {}, trees)


def finding(
    *lefts_and_scores: tuple[float, float], points: np.ndarray | None = None
) -> FramePrediction:
    boxes = np.array([[left, 0, left + 10, 40] for left, _ in lefts_and_scores], float)
    scores = np.array([score for _, score in lefts_and_scores])
    return FramePrediction(boxes.reshape(-1, 4), scores, points, None)


def test_the_highest_score_matches_and_a_second_detection_is_a_false_positive() -> None:
    found = finding((1, 0.6), (0, 0.9), (100, 0.55))
    matches = match_trees([frame(tree(0), tree(50))], [found])
    assert matches.found == [Pair(0, 0, 1, 1.0)]
    assert matches.missed == [(0, 1)]
    assert matches.invented == [(0, 0), (0, 2)]
    assert matches.recall == 0.5
    assert matches.precision == pytest.approx(1 / 3)


def test_two_neighbours_match_two_detections() -> None:
    # The second detection overlaps the first tree more, but that one is taken.
    found = finding((0, 0.9), (2, 0.8))
    matches = match_trees([frame(tree(0), tree(4))], [found])
    assert [(pair.tree, pair.row) for pair in matches.found] == [(0, 0), (1, 1)]


def test_low_scores_and_small_overlaps_do_not_match() -> None:
    found = finding((0, 0.49), (54, 0.9))
    matches = match_trees([frame(tree(0), tree(50))], [found])
    assert matches.found == []
    assert matches.invented == [(0, 1)]  # IoU of 6 / 14


def test_detections_in_a_crowd_are_ignored() -> None:
    matches = match_trees([frame(tree(0, crowd=True))], [finding((2, 0.9), (9, 0.9))])
    assert (matches.found, matches.missed) == ([], [])
    assert matches.invented == [(0, 1)]


def leaning(rng: np.random.Generator) -> np.ndarray:
    """The keypoints of a tree with a random lean, all labelled."""
    angle = rng.uniform(-0.5, 0.5)
    up, right = np.array([np.sin(angle), -np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    cut, half = rng.uniform(50, 100, 2), rng.uniform(3, 9)
    xy = [
        cut,
        cut + 5 * up - half * right,
        cut + 5 * up + half * right,
        cut + 20 * up,
        cut + 45 * up,
    ]
    return np.column_stack([xy, np.full(5, 2)])


def test_errors_equal_a_separate_computation() -> None:
    rng = np.random.default_rng(5)
    truth = [leaning(rng) for _ in range(20)]
    moved = [points + np.pad(rng.normal(0, 4, (5, 2)), ((0, 0), (0, 1))) for points in truth]
    frames = [frame(tree(0, points)) for points in truth]
    found = [finding((0, 0.9), points=points[None]) for points in moved]
    errors = measure_errors(frames, found, match_trees(frames, found).found)
    assert errors is not None
    for index, (true, guess) in enumerate(zip(truth, moved, strict=True)):
        stem = true[4, :2] - true[0, :2]
        angle = np.arctan2(stem[0], -stem[1])  # of the trunk from the vertical
        for point in range(5):
            dx, dy = guess[point, :2] - true[point, :2]
            across = dx * np.cos(angle) + dy * np.sin(angle)
            along = dx * np.sin(angle) - dy * np.cos(angle)
            expected = [np.sqrt(dx**2 + dy**2), across, along, dx, dy]
            assert errors.keypoints[index, point].tolist() == pytest.approx(expected)
        widths = [np.hypot(*(points[2, :2] - points[1, :2])) for points in (true, guess)]
        assert errors.width[index] == pytest.approx(widths[1] - widths[0])
    sizes = [abs(value) for value in errors.width.tolist()]
    spread = Spread.of(errors.width)
    assert spread is not None
    assert spread.mean_abs == pytest.approx(sum(sizes) / 20)
    assert spread.mean == pytest.approx(sum(errors.width.tolist()) / 20)
    assert spread.median_abs == pytest.approx(sum(sorted(sizes)[9:11]) / 2)


def test_the_signs_of_errors_of_an_upright_tree() -> None:
    points = np.column_stack([[[50, 90], [45, 85], [55, 85], [50, 60], [50, 30]], np.full(5, 2)])
    guess = points.astype(float)
    guess[0] += [3, -4, 0]
    frames, found = [frame(tree(0, points))], [finding((0, 0.9), points=guess[None])]
    errors = measure_errors(frames, found, match_trees(frames, found).found)
    assert errors is not None
    ways = ("distance", "across", "along", "horizontal", "vertical")
    assert [errors.of(0, way)[0] for way in ways] == [5, 3, 4, 3, -4]


def test_unlabelled_keypoints_have_no_errors() -> None:
    points = np.column_stack([[[50, 90], [45, 85], [0, 0], [50, 60], [0, 0]], [2, 2, 0, 1, 0]])
    guess = points + np.array([1.0, 0, 0])
    frames, found = [frame(tree(0, points))], [finding((0, 0.9), points=guess[None])]
    errors = measure_errors(frames, found, match_trees(frames, found).found)
    assert errors is not None
    assert np.isnan(errors.of(2, "distance"))
    assert np.isnan(errors.of(4, "distance"))
    assert np.isnan(errors.width)
    # Without the top, the middle gives the axis.
    assert errors.of(0, "across") == pytest.approx(1)
    assert Spread.of(errors.width) is None


def test_without_keypoints_there_are_no_errors() -> None:
    frames, found = [frame(tree(0))], [finding((0, 0.9))]
    assert measure_errors(frames, found, match_trees(frames, found).found) is None
    found = [finding((0, 0.9), points=np.zeros((1, 5, 3)))]
    assert measure_errors(frames, found, match_trees(frames, found).found) is None


def test_histograms_and_the_density_count_every_error_once() -> None:
    values = np.array([-0.5, 0.2, 0.3, 3.0, 50.0, np.nan])
    counts = histogram(values, 4.0)
    assert sum(counts["counts"]) == 4
    assert counts["beyond"] == 1
    right, down = np.array([1.0, 1.0, -1.0]), np.array([2.0, 2.0, -1.0])
    found = density(right, down)
    assert found is not None
    rows = np.array(found["rows"])
    assert rows.sum() + found["beyond"] == 3
    row, column = np.unravel_index(rows.argmax(), rows.shape)
    assert row > column > len(rows) // 2  # lower than right, both positive
