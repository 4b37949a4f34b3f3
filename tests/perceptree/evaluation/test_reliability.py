"""Scores as probabilities."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from perceptree.data import FrameRecord, TreeRecord
from perceptree.errors import DatasetError
from perceptree.evaluation.predictions import FramePrediction
from perceptree.evaluation.reliability import (
    Scored,
    ScoreScale,
    fit_scale,
    reliability,
    scored_detections,
)
from perceptree.models.heads import BoxHead


def drawn(slope: float, offset: float, count: int = 20_000) -> Scored:
    """Detections that are right as often as the scaled scores say."""
    random = np.random.default_rng(3)
    score = random.uniform(0.05, 0.999, count)
    drawn = Scored(score, score > 0, np.zeros(count))
    right = random.random(count) < ScoreScale(slope, offset).apply(drawn)
    return drawn._replace(right=right)


def test_each_detection_is_right_or_wrong_and_those_in_a_crowd_neither() -> None:
    def tree(left: float, crowd: bool = False) -> TreeRecord:
        box = np.array([left, 0, left + 10, 40.0])
        return TreeRecord(1, box, np.zeros((5, 3)), None, crowd, {})

    frame = FrameRecord(7, Path("7.png"), None, None, 300, 50, {}, (tree(0), tree(200, crowd=True)))
    lefts = np.array([0.0, 1.0, 100.0, 201.0, 150.0])
    boxes = np.stack([lefts, 0 * lefts, lefts + 10, 0 * lefts + 40], 1)
    scores = np.array([0.9, 0.3, 0.06, 0.8, 0.04])
    scored = scored_detections([frame], [FramePrediction(boxes, scores, None, None)])
    found = sorted(zip(*(values.tolist() for values in scored[:3]), strict=True))
    assert found == [(0.06, False, 0.0), (0.3, False, 0.0), (0.9, True, 1.0)]
    assert scored.certainty is None


def test_scores_that_are_probabilities_have_no_error_and_too_sure_ones_do() -> None:
    assert reliability(drawn(1.0, 0.0))["expected_error"] < 0.015
    found = reliability(drawn(0.4, -1.0))
    assert found["expected_error"] > 0.15
    highest = found["bins"][-1]
    assert highest["right"] < highest["mean_score"] - 0.1
    assert sum(each["detections"] for each in found["bins"]) == found["detections"] == 20_000


def test_datasets_count_the_same_whatever_their_size() -> None:
    few, many = drawn(1.0, 1.0, 2_000), drawn(1.0, -1.0, 20_000)
    both = fit_scale([few, many])
    turned = fit_scale([drawn(1.0, 1.0, 20_000), drawn(1.0, -1.0, 2_000)])
    assert both.offset == pytest.approx(0.0, abs=0.15)
    assert both == pytest.approx(turned, abs=0.15)
    assert fit_scale([few, few, many]).offset > both.offset + 0.2


def test_no_detections_have_no_error() -> None:
    found = reliability(Scored(np.zeros(0), np.zeros(0, bool), np.zeros(0)))
    assert found["expected_error"] is None
    assert {each["right"] for each in found["bins"]} == {None}


def test_the_fit_finds_the_scale_and_makes_scores_probabilities() -> None:
    scored = drawn(0.4, -1.0)
    scale = fit_scale([scored])
    assert scale == pytest.approx((0.4, -1.0, 0.0), abs=0.06)
    after = scored._replace(score=scale.apply(scored))
    assert reliability(after)["expected_error"] < 0.015


def test_masks_count_as_far_as_they_tell_how_exact_a_box_is() -> None:
    random = np.random.default_rng(5)
    score, certainty = random.uniform(0.05, 0.95, 20_000), random.uniform(0.5, 0.97, 20_000)
    exact = ScoreScale(1.0, -1.0, 0.8).apply(Scored(score, score > 0, score, certainty))
    iou = np.where(random.random(20_000) < exact, random.uniform(0.5, 1.0, 20_000), 0.0)
    scored = Scored(score, iou > 0, iou, certainty)
    scale = fit_scale([scored])
    assert scale.mask / scale.slope == pytest.approx(0.8, abs=0.1)
    after = scored._replace(score=scale.apply(scored))
    assert reliability(after)["expected_error"] < 0.02
    unrelated = scored._replace(certainty=random.permutation(certainty))
    assert fit_scale([unrelated]).mask < 0.05
    assert fit_scale([scored._replace(certainty=None)]).mask == 0.0


def test_masks_count_where_their_certainty_tells_how_exact_masks_or_keypoints_are() -> None:
    random = np.random.default_rng(7)
    score, certainty = random.uniform(0.05, 0.95, 20_000), random.uniform(0.5, 0.97, 20_000)
    right = random.random(20_000) < score
    iou = np.where(right, random.uniform(0.5, 1.0, 20_000), 0.0)
    scored = Scored(score, right, iou, certainty)
    told = scored._replace(others=(np.where(right, certainty, 0.0),))
    untold = scored._replace(others=(iou,))
    unlabelled = scored._replace(others=(np.where(right, np.nan, 0.0),))
    assert fit_scale([scored]).mask < 0.05
    assert fit_scale([untold]).mask < 0.05
    assert fit_scale([unlabelled]).mask < 0.05
    assert fit_scale([told]).mask > 0.1


def test_masks_can_count_without_a_change_of_the_level() -> None:
    random = np.random.default_rng(6)
    score, certainty = random.uniform(0.05, 0.95, 20_000), random.uniform(0.5, 0.97, 20_000)
    rare = Scored(score, random.random(20_000) < 0.3 * score, score, certainty)
    rare = rare._replace(iou=np.where(rare.right, certainty, 0.0))
    kept, scaled = fit_scale([rare], keep_level=True), fit_scale([rare])
    assert kept.mask > 0.1
    assert kept.apply(rare).mean() == pytest.approx(score.mean(), abs=0.01)
    assert scaled.apply(rare).mean() == pytest.approx(rare.right.mean(), abs=0.01)


def test_too_few_wrong_detections_cannot_be_fitted() -> None:
    score = np.linspace(0.1, 0.9, 500)
    with pytest.raises(DatasetError, match="450 right and 50 wrong"):
        fit_scale([Scored(score, np.arange(500) < 450, score)])


def test_the_scale_becomes_part_of_the_weights() -> None:
    torch.manual_seed(0)
    head, regions = BoxHead(4, 8), torch.randn(50, 4, 7, 7)
    torch.nn.init.normal_(head.score.weight)
    before = head(regions)[0].softmax(1)[:, 0].detach().numpy()
    head.scale_scores(0.6, -0.7)
    after = head(regions)[0].softmax(1)[:, 0].detach().numpy()
    assert np.ptp(before) > 0.2
    scored = Scored(before, before > 0, before)
    np.testing.assert_allclose(after, ScoreScale(0.6, -0.7).apply(scored), atol=1e-3)
