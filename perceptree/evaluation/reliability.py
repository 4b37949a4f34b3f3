"""Whether scores are probabilities: of detections with a score of 0.9, nine in ten are right."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from perceptree.data import FrameRecord
from perceptree.errors import DatasetError
from perceptree.evaluation.matching import match_trees
from perceptree.evaluation.predictions import FramePrediction

LEAST_SCORE = 0.05
_BINS = 10
_FEWEST = 100
_STEPS = 50
# Logistic regression is kept from running away where a score separates right from wrong entirely.
_RIDGE = 1e-3


class Scored(NamedTuple):
    """Detections of labelled frames.

    Attributes:
        score: (N,) score, from `LEAST_SCORE` on.
        right: (N,) whether the detection is a labelled tree, at a box IoU of 0.5.
    """

    score: Float
    right: Bool


class ScoreScale(NamedTuple):
    """A change of scores that keeps their order: logit(new) = slope * logit(old) + offset."""

    slope: float
    offset: float

    def apply(self, score: Float) -> Float:
        """The changed scores."""
        return np.asarray(_sigmoid(self.slope * _logit(score) + self.offset))


def scored_detections(
    frames: Sequence[FrameRecord], predictions: Sequence[FramePrediction]
) -> Scored:
    """Match all detections from `LEAST_SCORE` on; those inside an ignored region are left out."""
    matches = match_trees(frames, predictions, LEAST_SCORE)
    rows = [(pair.frame, pair.row, True) for pair in matches.found]
    rows += [(frame, row, False) for frame, row in matches.invented]
    return Scored(
        np.array([predictions[frame].scores[row] for frame, row, _ in rows], np.float64),
        np.array([right for *_, right in rows], np.bool_),
    )


def joined(sets: Sequence[Scored]) -> Scored:
    """The detections of all datasets, one after the other."""
    return Scored(
        np.concatenate([one.score for one in sets]), np.concatenate([one.right for one in sets])
    )


def reliability(scored: Scored) -> dict[str, Any]:
    """The share of right detections by score, JSON-ready.

    Returns:
        `bins` of equal width with the number of detections, their mean score and the share that
        is right (both None if empty), and `expected_error`: the mean difference of the two,
        weighted by the number of detections (expected calibration error, Naeini et al. 2015); None
        without detections.
    """
    edges = np.linspace(0, 1, _BINS + 1)
    which = np.clip(np.digitize(scored.score, edges) - 1, 0, _BINS - 1)
    bins, off = [], 0.0
    for number in range(_BINS):
        inside = which == number
        count = int(inside.sum())
        mean = float(scored.score[inside].mean()) if count else None
        right = float(scored.right[inside].mean()) if count else None
        if mean is not None and right is not None:
            off += count * abs(mean - right)
        bins.append(
            {
                "from": round(float(edges[number]), 2),
                "to": round(float(edges[number + 1]), 2),
                "detections": count,
                "mean_score": None if mean is None else round(mean, 4),
                "right": None if right is None else round(right, 4),
            }
        )
    total = len(scored.score)
    return {
        "least_score": LEAST_SCORE,
        "detections": total,
        "expected_error": round(off / total, 4) if total else None,
        "bins": bins,
    }


def fit_scale(sets: Sequence[Scored]) -> ScoreScale:
    """Fit the scale that makes scores probabilities, by logistic regression (Platt 1999).

    Args:
        sets: Detections of each dataset. All datasets count the same, whatever their size.

    Raises:
        DatasetError: There are too few detections, or all of them are right, or wrong.
    """
    scored = joined(sets)
    right = int(scored.right.sum())
    wrong = len(scored.right) - right
    if min(right, wrong) < _FEWEST:
        raise DatasetError(
            f"{right} right and {wrong} wrong detections with a score of {LEAST_SCORE} and more:"
            f" expected {_FEWEST} or more of both to fit scores"
        )
    counts = np.array([len(one.score) for one in sets if len(one.score)])
    shares = np.repeat(len(scored.score) / len(counts) / counts, counts)
    x = np.stack([_logit(scored.score), np.ones_like(scored.score)], axis=1)
    at = np.array([1.0, 0.0])
    prior = at.copy()
    for _ in range(_STEPS):
        expected = _sigmoid(x @ at)
        gradient = x.T @ (shares * (expected - scored.right)) + _RIDGE * (at - prior)
        weight = shares * expected * (1 - expected)
        step = np.linalg.solve((x * weight[:, None]).T @ x + _RIDGE * np.eye(2), gradient)
        at = at - step
        if np.abs(step).max() < 1e-10:
            break
    return ScoreScale(float(at[0]), float(at[1]))


def _logit(score: Float) -> Float:
    inside = np.clip(score, 1e-6, 1 - 1e-6)
    return np.asarray(np.log(inside) - np.log1p(-inside))


def _sigmoid(x: Float) -> Float:
    return np.asarray(1 / (1 + np.exp(-x)))
