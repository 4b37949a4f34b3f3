"""Hold a backbone near its starting weights, so that it does not forget what it knew.

Two ways: a pull of the weights (L2-SP, Li, Grandvalet and Davoine 2018, "Explicit inductive bias
for transfer learning"), and a loss on the difference of its maps from those of the starting
backbone on the same pictures (Li et al. 2019, "DELTA").
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn

from perceptree.models import TreeRCNN
from perceptree.models.backbones import Backbone
from perceptree.settings.training import TrainSettings

_LEAST_VARIANCE = 1e-6


class StartingBackbone:
    """The backbone as it was at the start.

    Args:
        model: The model, with its starting weights.
        settings: Strengths of the pull and of the loss.
    """

    def __init__(self, model: TreeRCNN, settings: TrainSettings) -> None:
        spec = model.spec
        self._settings, self._backbone = settings, model.backbone
        self._start = Backbone(
            spec.backbone, spec.channels, spec.backbone_levels, spec.stride_in_1x1
        )
        self._start.load_state_dict(model.backbone.state_dict())
        self._start.to(next(model.parameters()).device).to(memory_format=torch.channels_last)
        self._start.requires_grad_(False).eval()
        self._maps: list[Tensor] = []
        if settings.keep_features:
            model.backbone.register_forward_hook(self._remember)

    def state(self) -> dict[str, Tensor]:
        """The starting weights, to go on with after an interruption."""
        return self._start.state_dict()

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Take the starting weights of an interrupted training."""
        self._start.load_state_dict(state)

    def _remember(self, module: nn.Module, inputs: tuple[Tensor], maps: list[Tensor]) -> None:
        self._images, self._maps = inputs[0], maps

    def loss(self) -> dict[str, Tensor]:
        """The loss `features` of the last forward pass; empty without it.

        It is the mean over images and levels of the squared difference of an image's maps, divided
        by the variance of its starting map. So processes with parts of a batch have the loss of the
        joint batch.
        """
        if not self._settings.keep_features:
            return {}
        with torch.no_grad():
            starts = self._start(self._images)
        parts = [
            (own.float() - start.float()).square().flatten(1).mean(1)
            / start.float().flatten(1).var(1).clamp(min=_LEAST_VARIANCE)
            for own, start in zip(self._maps, starts, strict=True)
        ]
        self._maps = []
        return {"features": self._settings.keep_features * torch.stack(parts).mean()}

    def pull(self, rate: float) -> None:
        """Move the trained weights towards the starting ones after a step.

        Args:
            rate: Learning rate of the backbone in this step.
        """
        share = min(1.0, rate * self._settings.keep_weights)
        pairs = zip(self._backbone.parameters(), self._start.parameters(), strict=True)
        with torch.no_grad():
            for own, start in pairs:
                if share and own.requires_grad:
                    own.lerp_(start, share)
