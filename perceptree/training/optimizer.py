"""The optimizer of a training."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from perceptree.models import TreeRCNN
from perceptree.settings.training import TrainSettings

_RATE_SHARE = "rate_share"


def make_optimizer(model: TreeRCNN, settings: TrainSettings) -> torch.optim.Optimizer:
    """Make AdamW or SGD for the trainable parameters, without weight decay for norms and biases.

    The backbone has groups of its own if its learning rate differs.

    Args:
        model: The model; its frozen parameters are left out.
        settings: Kind of optimizer, learning rates, momentum and weight decay.
    """
    share = settings.backbone_rate_share
    apart = list(model.backbone.parameters()) if share != 1 else []
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
