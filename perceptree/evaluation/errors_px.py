"""How far keypoints and diameters are off, in px of the pictures as they are on disk."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.data import FrameRecord
from perceptree.evaluation.matching import Pair
from perceptree.evaluation.predictions import FramePrediction
from perceptree.keypoints import KEYPOINT_NAMES

Float = NDArray[np.floating[Any]]

CUT, LEFT, RIGHT, MIDDLE, TOP = range(len(KEYPOINT_NAMES))
DIRECTIONS = ("distance", "across", "along", "horizontal", "vertical")
_HISTOGRAM_BINS = 60
_DENSITY_BINS = 41
_SHOWN_PERCENT = 97.0


@dataclass(frozen=True)
class Spread:
    """Errors of many trees, px: with their sign where they have one.

    ``sigma`` is the standard deviation about the mean; ``p90_abs`` the size that nine of ten
    errors stay below.
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
        """Of (N,) errors, NaN ones left out; None where there is none."""
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
        """JSON-ready, rounded to a thousandth of a px."""
        return {name: round(value, 3) for name, value in dataclasses.asdict(self).items()}


@dataclass(frozen=True, eq=False)
class PixelErrors:
    """Of P trees that were found; NaN where the label lacks a keypoint.

    ``keypoints`` (P, 5, 5) by ``KEYPOINT_NAMES`` and ``DIRECTIONS``: distance; across the stem,
    to the right for a standing tree; along it, to the top; horizontal, to the right; vertical,
    down. ``true_width`` and ``found_width`` (P,) are distances of the two diameter keypoints.
    """

    keypoints: Float
    true_width: Float
    found_width: Float

    @property
    def width(self) -> Float:
        """(P,) found less true distance of the diameter keypoints, px."""
        return np.asarray(self.found_width - self.true_width)

    def of(self, keypoint: int, direction: str) -> Float:
        """(P,) errors of one keypoint in one of ``DIRECTIONS``."""
        return np.asarray(self.keypoints[:, keypoint, DIRECTIONS.index(direction)])


def measure_errors(
    frames: Sequence[FrameRecord], predictions: Sequence[FramePrediction], found: Sequence[Pair]
) -> PixelErrors | None:
    """Of all pairs; None where the model gives no keypoints or no pair has a labelled one."""
    if any(prediction.keypoints is None for prediction in predictions):
        return None
    truth, guess = np.zeros((2, len(found), len(KEYPOINT_NAMES), 2))
    for place, pair in enumerate(found):
        labelled = frames[pair.frame].trees[pair.tree].keypoints
        truth[place] = np.where(labelled[:, 2:] > 0, labelled[:, :2], np.nan)
        keypoints = predictions[pair.frame].keypoints
        guess[place] = 0 if keypoints is None else keypoints[pair.row, :, :2]
    if np.isnan(truth).all():
        return None
    gap = guess - truth
    along = _axes(truth)[:, None]
    right = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    parts = [np.hypot(*np.moveaxis(gap, -1, 0)), (gap * right).sum(-1), (gap * along).sum(-1)]
    true_width, found_width = (
        np.linalg.norm(points[:, RIGHT] - points[:, LEFT], axis=-1) for points in (truth, guess)
    )
    errors = np.stack([*parts, gap[..., 0], gap[..., 1]], axis=-1)
    return PixelErrors(errors, true_width, np.where(np.isnan(true_width), np.nan, found_width))


def _axes(truth: Float) -> Float:
    """(P, 2) unit vectors up the true stems, from the cut to the top; NaN where unknown.

    Without one of these two, the middle stands in for it.
    """
    low, middle, high = truth[:, CUT], truth[:, MIDDLE], truth[:, TOP]
    start = np.where(np.isnan(low), middle, low)
    end = np.where(np.isnan(high), middle, high)
    axis = end - start
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    return np.asarray(axis / np.where(length > 0, length, np.nan))


def histogram(errors: Float, reach: float) -> dict[str, Any]:
    """Counts of errors from -``reach`` to ``reach`` px; what lies beyond is counted as such."""
    values = errors[np.isfinite(errors)]
    edges = np.linspace(-reach, reach, _HISTOGRAM_BINS + 1)
    return {
        "from_px": -reach,
        "to_px": reach,
        "counts": np.histogram(values, edges)[0].tolist(),
        "beyond": int((np.abs(values) > reach).sum()),
    }


def density(horizontal: Float, vertical: Float) -> dict[str, Any] | None:
    """Counts of errors in the plane, rows downwards, px; the paper's map of the felling cut."""
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
    """A round number of px that most errors stay below."""
    values = np.abs(errors[np.isfinite(errors)])
    most = max(float(np.percentile(values, _SHOWN_PERCENT)) if len(values) else 0.0, 1.0)
    step = 10.0 ** math.floor(math.log10(most))
    return float(next(m for m in (1, 2, 3, 4, 5, 6, 8, 10) if m * step >= most) * step)
