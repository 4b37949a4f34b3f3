"""Scores of trees by their boxes and their masks."""

from __future__ import annotations

import torch
from torch import Tensor

MASK_THRESHOLD = 0.5
MOST_CERTAIN = 0.98
"""Largest certainty of a mask that counts, so that a mask cannot make a tree of any box."""


def mask_certainty(masks: Tensor) -> Tensor:
    """How certain masks are: the mean probability of the cells that show the stem.

    The idea is that of "maskness" in SOLOv2 (Wang et al. 2020): where outlines are unclear, they
    are wrong more often, and so is the box.

    Args:
        masks: (..., C, C) probabilities.

    Returns:
        (...), 0.5 to 1; 0.5 for masks without such a cell.
    """
    shown = masks >= MASK_THRESHOLD
    total = torch.where(shown, masks, 0.0).sum(dim=(-2, -1))
    count = shown.sum(dim=(-2, -1))
    return torch.where(count > 0, total / count.clamp(min=1), MASK_THRESHOLD)


def joint_scores(scores: Tensor, certainty: Tensor, weight: float) -> Tensor:
    """Scores (...) of boxes with those of their masks.

    The logit of the score grows by `weight` times the logit of the mask's certainty, up to that of
    `MOST_CERTAIN`.

    Args:
        scores: (...) scores of the boxes, 0 to 1.
        certainty: (...) as from `mask_certainty`.
        weight: `ModelSpec.mask_score_weight`.
    """
    certainty = certainty.clamp(max=MOST_CERTAIN)
    # No power: model files do without that operator.
    odds = torch.exp(weight * torch.log(certainty / (1.0 - certainty)))
    return _multiply_odds(scores, odds)


def highest_scores(scores: Tensor, weight: float) -> Tensor:
    """Scores (...) of boxes with the most certain masks, see `joint_scores`."""
    return _multiply_odds(scores, (MOST_CERTAIN / (1.0 - MOST_CERTAIN)) ** weight)


def _multiply_odds(score: Tensor, factor: Tensor | float) -> Tensor:
    """The probability whose odds are so many times those of `score`."""
    likely = score * factor
    return likely / (1.0 - score + likely)
