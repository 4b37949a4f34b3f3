"""Whether scores are probabilities: of detections with a score of 0.9, nine in ten are right."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from perceptree.data import FrameRecord
from perceptree.errors import DatasetError
from perceptree.evaluation.matching import match_trees
from perceptree.evaluation.pair_overlaps import keypoint_similarities, mask_ious
from perceptree.evaluation.predictions import FramePrediction
from perceptree.models.scores import MOST_CERTAIN

LEAST_SCORE = 0.05
_BINS = 10
_FEWEST = 100
_STEPS = 50
# COCO's overlaps, of which average precision is the mean.
_OVERLAPS = np.linspace(0.5, 0.95, 10)
# Logistic regression is kept from running away where a score separates right from wrong entirely.
_RIDGE = 1e-3


class Scored(NamedTuple):
    """Detections of labelled frames.

    Attributes:
        score: (N,) score, from `LEAST_SCORE` on.
        right: (N,) whether the detection is a labelled tree, at a box IoU of 0.5.
        iou: (N,) box IoU with that tree, 0 for those that are wrong.
        certainty: (N,) how certain the masks are; None without masks.
        others: (N,) mask IoU and keypoint similarity with that tree, as far as the model has masks
            and keypoints; 0 for those that are wrong, NaN where the tree has no label.
    """

    score: Float
    right: Bool
    iou: Float
    certainty: Float | None = None
    others: tuple[Float, ...] = ()


class ScoreScale(NamedTuple):
    """A change of scores: logit(new) = slope * logit(old) + offset + mask * logit(certainty)."""

    slope: float
    offset: float
    mask: float = 0.0

    def apply(self, scored: Scored) -> Float:
        """The changed scores."""
        logit = self.slope * _logit(scored.score) + self.offset
        if scored.certainty is not None:
            logit = logit + self.mask * _mask_logit(scored.certainty)
        return np.asarray(_sigmoid(logit))


def scored_detections(
    frames: Sequence[FrameRecord], predictions: Sequence[FramePrediction]
) -> Scored:
    """Match all detections from `LEAST_SCORE` on; those inside an ignored region are left out."""
    matches = match_trees(frames, predictions, LEAST_SCORE)
    rows = [(pair.frame, pair.row, pair.iou) for pair in matches.found]
    rows += [(frame, row, 0.0) for frame, row in matches.invented]
    iou = np.array([overlap for *_, overlap in rows], np.float64)
    certain = all(each.certainty is not None for each in predictions)
    return Scored(
        _of_rows([each.scores for each in predictions], rows),
        np.arange(len(rows)) < len(matches.found),
        iou,
        _of_rows([each.certainty for each in predictions], rows) if certain else None,
        tuple(
            np.pad(overlaps, (0, len(matches.invented)))
            for overlaps in (
                mask_ious(frames, predictions, matches.found),
                keypoint_similarities(frames, predictions, matches.found),
            )
            if overlaps is not None
        ),
    )


def _of_rows(values: Sequence[Any], rows: Sequence[tuple[int, int, float]]) -> Float:
    return np.array([values[frame][row] for frame, row, _ in rows], np.float64)


def joined(sets: Sequence[Scored]) -> Scored:
    """The detections of all datasets, one after the other."""
    certain = [one.certainty for one in sets if one.certainty is not None]
    return Scored(
        np.concatenate([one.score for one in sets]),
        np.concatenate([one.right for one in sets]),
        np.concatenate([one.iou for one in sets]),
        np.concatenate(certain) if len(certain) == len(sets) else None,
        tuple(map(np.concatenate, zip(*(one.others for one in sets), strict=True))),
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


def fit_scale(sets: Sequence[Scored], keep_level: bool = False) -> ScoreScale:
    """Fit the scale that makes scores probabilities, by logistic regression (Platt 1999).

    How much masks count beside boxes is fitted first: so that the scores tell best which share of
    COCO's overlaps (0.50, 0.55 ... 0.95) a detection reaches. Its box, its mask and its keypoints
    count alike.

    Args:
        sets: Detections of each dataset. All datasets count the same, whatever their size.
        keep_level: Whether the scores are to stay about as high as they were, in place of becoming
            the probabilities of these datasets.

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
    logit, mask = _logit(scored.score), 0.0
    if scored.certainty is not None:
        certain = _mask_logit(scored.certainty)
        overlaps = np.stack([scored.iou, *scored.others])
        of_each = (overlaps[..., None] >= _OVERLAPS).mean(2)
        reached = np.nanmean(np.where(np.isnan(overlaps), np.nan, of_each), axis=0)
        of_box, of_mask, _ = _regression([logit, certain], reached, shares)
        mask = max(of_mask / of_box, 0.0) if of_box > 0 else 0.0
        logit = logit + mask * certain
    wanted = scored.score if keep_level else scored.right.astype(np.float64)
    slope, offset = _regression([logit], wanted, shares)
    return ScoreScale(slope, offset, slope * mask)


def _regression(columns: Sequence[Float], wanted: Float, shares: Float) -> list[float]:
    """Factors of the columns and an offset, by logistic regression.

    Args:
        columns: (N,) each.
        wanted: (N,) 0 to 1.
        shares: (N,) weights.
    """
    x = np.stack([*columns, np.ones_like(wanted)], axis=1)
    at = np.eye(x.shape[1])[0]
    prior = at.copy()
    for _ in range(_STEPS):
        expected = _sigmoid(x @ at)
        gradient = x.T @ (shares * (expected - wanted)) + _RIDGE * (at - prior)
        weight = shares * expected * (1 - expected)
        step = np.linalg.solve((x * weight[:, None]).T @ x + _RIDGE * np.eye(len(at)), gradient)
        at = at - step / max(1.0, float(np.abs(step).max()))  # Newton's steps may go too far
        if np.abs(step).max() < 1e-10:
            break
    return [float(each) for each in at]


def _mask_logit(certainty: Float) -> Float:
    return _logit(np.minimum(certainty, MOST_CERTAIN))


def _logit(score: Float) -> Float:
    inside = np.clip(score, 1e-6, 1 - 1e-6)
    return np.asarray(np.log(inside) - np.log1p(-inside))


def _sigmoid(x: Float) -> Float:
    return np.asarray(1 / (1 + np.exp(-x)))
