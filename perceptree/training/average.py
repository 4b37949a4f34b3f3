"""Exponential moving average of a model's weights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from perceptree.models import TreeRCNN


def make_average(model: TreeRCNN, decay: float) -> AveragedModel:
    """Make an exponential moving average of a model's weights and batch norm statistics.

    Args:
        model: Model to average.
        decay: Fraction of the average that an update keeps. At step n it is at most
            (1 + n) / (10 + n), so that the first steps are forgotten faster.

    Returns:
        The average, in eval mode; its ``update_parameters(model)`` is called after each step.
    """

    def update(averages: Sequence[Tensor], currents: Sequence[Tensor], updates: Any) -> None:
        kept = min(decay, (1 + int(updates)) / (10 + int(updates)))
        if averages[0].dtype.is_floating_point:
            torch._foreach_lerp_(list(averages), list(currents), 1 - kept)
        else:
            torch._foreach_copy_(list(averages), list(currents))

    average = AveragedModel(model, multi_avg_fn=update, use_buffers=True)
    average.requires_grad_(False)
    average.eval()
    return average
