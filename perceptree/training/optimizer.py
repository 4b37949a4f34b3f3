"""The optimizer of a training, its learning rate, and the moving average of the weights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from perceptree.models import TreeRCNN
from perceptree.settings.training import TrainSettings

_RATE_SHARE = "rate_share"


def make_optimizer(model: TreeRCNN, settings: TrainSettings) -> torch.optim.Optimizer:
    """Make AdamW or SGD for the trainable parameters, without weight decay for norms and biases.

    The backbones have groups of their own if their learning rate differs.

    Args:
        model: The model; its frozen parameters are left out.
        settings: Kind of optimizer, learning rates, momentum and weight decay.
    """
    share = settings.backbone_rate_share
    apart = [each for part in model.backbones for each in part.parameters()] if share != 1 else []
    inside = {id(parameter) for parameter in apart}
    rest = [parameter for parameter in model.parameters() if id(parameter) not in inside]
    groups = [*_groups(rest, settings, 1.0), *(_groups(apart, settings, share) if apart else [])]
    if settings.optimizer == "sgd":
        return torch.optim.SGD(groups, lr=settings.learning_rate, momentum=settings.momentum)
    return torch.optim.AdamW(groups, lr=settings.learning_rate)


def set_rate(optimizer: torch.optim.Optimizer, rate: float) -> None:
    """Set the learning rate; each group has its share of it."""
    for group in optimizer.param_groups:
        group["lr"] = rate * group.get(_RATE_SHARE, 1.0)


def learning_rate(settings: TrainSettings, step: int, done: float) -> float:
    """Compute the learning rate of a step.

    Args:
        settings: The schedule.
        step: Number of the step, from 0.
        done: Fraction of the training that is completed, 0 to 1.
    """
    warm = min(1.0, (step + 1) / settings.warmup_steps)
    if settings.schedule == "constant":
        share = 1.0
    elif settings.schedule == "steps":
        share = settings.rate_drop ** sum(step >= drop for drop in settings.rate_steps)
    else:
        fall = done if settings.schedule == "decay" else 0.5 * (1 - math.cos(math.pi * done))
        share = 1 - (1 - settings.final_rate_share) * fall
    return settings.learning_rate * warm * share


def _groups(
    parameters: list[nn.Parameter], settings: TrainSettings, share: float
) -> list[dict[str, Any]]:
    """Parameter groups with and without weight decay."""
    trained = [p for p in parameters if p.requires_grad]
    decays = (settings.weight_decay, [p for p in trained if p.ndim > 1])
    fixed = (0.0, [p for p in trained if p.ndim <= 1])
    return [
        {"params": chosen, "weight_decay": decay, _RATE_SHARE: share}
        for decay, chosen in (decays, fixed)
    ]


def make_average(model: TreeRCNN, decay: float) -> AveragedModel:
    """Make an exponential moving average of a model's weights and batch norm statistics.

    Args:
        model: Model to average.
        decay: Fraction of the average that an update keeps. At step n it is at most
            (1 + n) / (10 + n), so that the first steps are forgotten faster.

    Returns:
        The average, in eval mode; its `update_parameters(model)` is called after each step.
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
