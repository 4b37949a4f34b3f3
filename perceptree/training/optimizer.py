"""The optimizer of a training."""

from __future__ import annotations

import torch
from torch import nn

from perceptree.training.settings import TrainSettings


def make_optimizer(model: nn.Module, settings: TrainSettings) -> torch.optim.Optimizer:
    """Make AdamW or SGD for the trainable parameters, without weight decay for norms and biases.

    Args:
        model: The model; its frozen parameters are left out.
        settings: Kind of optimizer, learning rate, momentum and weight decay.
    """
    trained = [p for p in model.parameters() if p.requires_grad]
    groups = [
        {"params": [p for p in trained if p.ndim > 1], "weight_decay": settings.weight_decay},
        {"params": [p for p in trained if p.ndim <= 1], "weight_decay": 0.0},
    ]
    if settings.optimizer == "sgd":
        return torch.optim.SGD(groups, lr=settings.learning_rate, momentum=settings.momentum)
    return torch.optim.AdamW(groups, lr=settings.learning_rate)
