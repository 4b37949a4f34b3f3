"""Errors of keypoints and diameters in px of the source images."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from basetree.arrays import Float
from perceptree.data import FrameRecord
from perceptree.evaluation.matching import Pair
from perceptree.evaluation.predictions import FramePrediction
from perceptree.keypoints import KEYPOINT_NAMES

CUT, LEFT, RIGHT, MIDDLE, TOP = range(len(KEYPOINT_NAMES))
DIRECTIONS = ("distance", "across", "along", "horizontal", "vertical")
_HISTOGRAM_BINS = 60
_DENSITY_BINS = 41
_SHOWN_PERCENT = 97.0


@dataclass(frozen=True)
class Spread:
    """Statistics of signed errors in px.

    Attributes:
        count: Number of errors.
        mean: Mean.
        median: Median.
        median_abs: Median of the absolute errors.
        mean_abs: Mean of the absolute errors.
        sigma: Standard deviation about the mean.
        p90_abs: 90th percentile of the absolute errors.
    """

    count: int
    mean: float
    median: float
    median_abs: float
    mean_abs: float
    sigma: float
    p90_abs: float

    @classmethod
    def of(cls, errors: Float) -> Spread | None:
        """Compute the statistics of (N,) errors without NaN; None if there are none."""
        values = errors[np.isfinite(errors)]
        if not len(values):
            return None
        size = np.abs(values)
        return cls(
            len(values),
            *(
                float(value)
                for value in (
                    values.mean(),
                    np.median(values),
                    np.median(size),
                    size.mean(),
                    values.std(),
                    np.percentile(size, 90),
                )
            ),
        )

    def to_dict(self) -> dict[str, float]:
        """Return JSON-ready values, rounded to 0.001 px."""
        return {name: round(value, 3) for name, value in dataclasses.asdict(self).items()}


@dataclass(frozen=True, eq=False)
class PixelErrors:
    """Errors of P matched trees in px; NaN where a keypoint is not labelled.

    Attributes:
        keypoints: (P, 5, 5) predicted minus true, by `KEYPOINT_NAMES` and `DIRECTIONS`:
            distance; across the trunk's axis, positive to the right of an upright tree; along the
            axis, positive towards the top; horizontal, positive to the right; vertical, positive
            downwards.
        true_width: (P,) true distance of the two diameter keypoints.
        found_width: (P,) predicted distance of the two diameter keypoints.
    """

    keypoints: Float
    true_width: Float
    found_width: Float

    @property
    def width(self) -> Float:
        """(P,) predicted minus true distance of the diameter keypoints."""
        return np.asarray(self.found_width - self.true_width)

    def of(self, keypoint: int, direction: str) -> Float:
        """Return the (P,) errors of a keypoint in one of `DIRECTIONS`."""
        return np.asarray(self.keypoints[:, keypoint, DIRECTIONS.index(direction)])


def measure_errors(
    frames: Sequence[FrameRecord], predictions: Sequence[FramePrediction], found: Sequence[Pair]
) -> PixelErrors | None:
    """Compute the errors of all matched trees.

    Args:
        frames: Labelled frames.
        predictions: Predictions of the frames.
        found: Matched trees.

    Returns:
        The errors; None if the model has no keypoints or no matched tree has a labelled keypoint.
    """
    if any(prediction.keypoints is None for prediction in predictions):
        return None
    truth, predicted = np.zeros((2, len(found), len(KEYPOINT_NAMES), 2))
    for index, pair in enumerate(found):
        labelled = frames[pair.frame].trees[pair.tree].keypoints
        truth[index] = np.where(labelled[:, 2:] > 0, labelled[:, :2], np.nan)
        keypoints = predictions[pair.frame].keypoints
        predicted[index] = 0 if keypoints is None else keypoints[pair.row, :, :2]
    if np.isnan(truth).all():
        return None
    error = predicted - truth
    along = _axes(truth)[:, None]
    right = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    parts = [np.hypot(*np.moveaxis(error, -1, 0)), (error * right).sum(-1), (error * along).sum(-1)]
    true_width, found_width = (
        np.linalg.norm(points[:, RIGHT] - points[:, LEFT], axis=-1) for points in (truth, predicted)
    )
    errors = np.stack([*parts, error[..., 0], error[..., 1]], axis=-1)
    return PixelErrors(errors, true_width, np.where(np.isnan(true_width), np.nan, found_width))


def _axes(truth: Float) -> Float:
    """Return (P, 2) unit vectors along the true axes, from the cut to the top; NaN if unknown.

    If one of the two points is not labelled, the middle point is used for it.
    """
    low, middle, high = truth[:, CUT], truth[:, MIDDLE], truth[:, TOP]
    start = np.where(np.isnan(low), middle, low)
    end = np.where(np.isnan(high), middle, high)
    axis = end - start
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    return np.asarray(axis / np.where(length > 0, length, np.nan))


def histogram(errors: Float, reach: float) -> dict[str, Any]:
    """Return counts of errors from -`reach` to `reach` px, and the number outside."""
    values = errors[np.isfinite(errors)]
    edges = np.linspace(-reach, reach, _HISTOGRAM_BINS + 1)
    return {
        "from_px": -reach,
        "to_px": reach,
        "counts": np.histogram(values, edges)[0].tolist(),
        "beyond": int((np.abs(values) > reach).sum()),
    }


def density(horizontal: Float, vertical: Float) -> dict[str, Any] | None:
    """Return a 2D histogram of errors in px, rows downwards; the paper's map of the felling cut."""
    known = np.isfinite(horizontal) & np.isfinite(vertical)
    if not known.any():
        return None
    x, y = horizontal[known], vertical[known]
    reach = round_reach(np.concatenate([x, y]))
    edges = np.linspace(-reach, reach, _DENSITY_BINS + 1)
    counts = np.histogram2d(y, x, (edges, edges))[0].astype(int)
    return {
        "from_px": -reach,
        "to_px": reach,
        "rows": counts.tolist(),
        "beyond": int(len(x) - counts.sum()),
    }


def round_reach(errors: Float) -> float:
    """Return a round number of px that exceeds 97 % of the absolute errors."""
    values = np.abs(errors[np.isfinite(errors)])
    percentile = max(float(np.percentile(values, _SHOWN_PERCENT)) if len(values) else 0.0, 1.0)
    step = 10.0 ** math.floor(math.log10(percentile))
    return float(next(m for m in (1, 2, 3, 4, 5, 6, 8, 10) if m * step >= percentile) * step)
