"""How a depth camera draws the edges of surfaces, learned from the edges of a frame.

- Exact depth and point clouds: the background follows the surface at once.
- Time of flight: a reading at an edge sees both surfaces. It is lost, or lies between them, on both
  sides of a stem alike, and the surface ends a little too early.
- Stereo: windows at an edge match the nearer surface, which so extends outwards. One of the two
  cameras does not see the background beside a stem, so more readings are missing on one side. Many
  have steps of disparities, which grow with the square of the depth.
- Filled depth, as of projected point clouds and of filters that fill holes: there are no gaps, but
  edges are rough, and surfaces extend outwards.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from edgetree.measure.constants.edges import (
    EXACT_STD,
    FILLED_OUTWARDS,
    FILLED_STD,
    GROWN_BY_SQUARES,
    STEREO_OUTWARDS,
    STEREO_STD,
    TOF_OUTWARDS,
    TOF_STD,
)
from edgetree.measure.depth_steps import DepthSteps

# Longer gaps beside a surface are shadows of stereo, or the sky.
_SHORT_GAP = 2

AT_ONCE, GAP, SHADOW, MIXED, UNKNOWN = range(5)
"""What follows a surface: the background, a short or a long gap and then the background, a reading
of both, or nothing that is near."""

# A gap of sky is beside a stem along much of its length, so its stations count less.
_COUNTS_AS = np.array([1.0, 1.0, 0.25, 1.0])
# Parameters of Dirichlet distributions for the shares of the first four of these.
_EXACT = np.array([40.0, 0.5, 3.0, 0.5])
_TOF = np.array([8.0, 3.0, 0.8, 1.0])
_FILLED = np.array([8.0, 0.25, 0.3, 1.2])
_STEREO_SEEN = np.array([8.0, 1.0, 0.3, 0.4])
_STEREO_HIDDEN = np.array([2.0, 2.0, 2.0, 0.4])
# How likely exact depth, time of flight, stereo and filled depth are before looking.
_PRIOR = np.array([0.6, 0.19, 0.19, 0.02])
# Mean and standard deviation of the roughness of edges of exact and of other depth, in readings,
# and the most that it counts.
_SMOOTH, _ROUGH, _MOST_SMOOTH = (0.34, 0.09), (0.65, 0.12), 5.0
# Logarithms of how much likelier stereo is with steps of disparities, and the others without.
_LOG_STEPS, _LOG_NO_STEPS = 8.0, 3.0


class DrawnEdges(NamedTuple):
    """Where surfaces end in a depth image.

    Attributes:
        outwards_px: How far outside of the true edges.
        std_px: Standard deviation of that, which all edges of the frame share.
    """

    outwards_px: float
    std_px: float


def beside(gap: Index, mixed: Bool, seen: Bool) -> Index:
    """What follows a surface.

    Args:
        gap: (...) number of missing readings between the surface and the next reading.
        mixed: (...) whether that lies between the surface and the background.
        seen: (...) whether there is a background.
    """
    after_gap = np.where(gap > _SHORT_GAP, SHADOW, np.where(gap > 0, GAP, AT_ONCE))
    return np.where(seen, np.where(mixed, MIXED, after_gap), UNKNOWN)


def drawn_edges(beside: Index, roughness_px: float, steps: DepthSteps) -> DrawnEdges:
    """How a camera draws edges, by what follows the surfaces of stems.

    Each kind of camera has a likelihood for the counts: Dirichlet-multinomial distributions, of
    both sides together, or for stereo of each side. The result is the mean over the kinds,
    weighed by it.

    Args:
        beside: (2, T, S) what follows at the left and right edges.
        roughness_px: Standard deviation of the ends of surfaces about straight lines; NaN if it is
            not known.
        steps: The steps of the depth.
    """
    side_px = steps.side_px
    left, right = (
        np.bincount(side.ravel(), minlength=UNKNOWN)[:UNKNOWN] * _COUNTS_AS for side in beside
    )
    shadows = [
        _log_likelihood(hidden, _STEREO_HIDDEN) + _log_likelihood(open_, _STEREO_SEEN)
        for hidden, open_ in ((left, right), (right, left))
    ]
    evidence = np.array(
        [
            _log_likelihood(left + right, _EXACT),
            _log_likelihood(left + right, _TOF),
            np.logaddexp(shadows[0], shadows[1]) - math.log(2),
            _log_likelihood(left + right, _FILLED),
        ]
    )
    evidence += np.log(_PRIOR)
    evidence[0] += _log_smooth(roughness_px / side_px)
    evidence[2] += _LOG_STEPS if steps.of_disparities else -_LOG_NO_STEPS
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    grown_px = GROWN_BY_SQUARES * (side_px - 1)
    outwards_px = side_px * np.array([0.0, TOF_OUTWARDS, STEREO_OUTWARDS, FILLED_OUTWARDS])
    outwards_px += grown_px
    std_px = side_px * np.array([EXACT_STD, TOF_STD, STEREO_STD, FILLED_STD])
    mean_px = float(weight @ outwards_px)
    variance = float(weight @ (std_px**2 + (outwards_px - mean_px) ** 2))
    return DrawnEdges(mean_px, math.sqrt(variance))


def _log_smooth(roughness: float) -> float:
    """Logarithm of how much likelier a roughness in readings is for exact depth than for others.

    The ends of exact surfaces are rough only by the size of a reading. So real bark is no proof
    against them.
    """
    if math.isnan(roughness):
        return 0.0
    smooth, rough = (
        -(((roughness - mean) / std) ** 2) / 2 - math.log(std) for mean, std in (_SMOOTH, _ROUGH)
    )
    return float(np.clip(smooth - rough, -_MOST_SMOOTH, _MOST_SMOOTH))


def _log_likelihood(counts: Float, prior: Float) -> float:
    """Of counts under a Dirichlet distribution of their shares, but for their number of orders."""
    after = counts + prior
    single = sum(map(math.lgamma, after.tolist())) - sum(map(math.lgamma, prior.tolist()))
    return single + math.lgamma(prior.sum()) - math.lgamma(after.sum())
