"""Averaged weights, by torch's own AveragedModel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from perceptree.models import TreeRCNN


def averaged(model: TreeRCNN, decay: float) -> AveragedModel:
    """A running average of the model's weights and statistics, ``decay`` of it kept each step.

    It forgets the first steps faster: after n steps at most (1 + n) / (10 + n) is kept.
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
