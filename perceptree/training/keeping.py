"""Hold the backbones near their starting weights, so that they do not forget what they knew.

Two ways: a pull of the weights (L2-SP, Li, Grandvalet and Davoine 2018, "Explicit inductive bias
for transfer learning"), and a loss on the difference of its maps from those of the starting
backbone on the same pictures (Li et al. 2019, "DELTA").
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn

from perceptree.models import TreeRCNN
from perceptree.models.backbones import Backbone
from perceptree.models.losses import CountReducer, local_count
from perceptree.settings.training import TrainSettings

_LEAST_VARIANCE = 1e-6
_COLOUR = "colour."  # before the names of the colour backbone's tensors


class StartingBackbone:
    """The backbone as it was at the start, and the colour backbone where there is one.

    Args:
        model: The model, with its starting weights.
        settings: Strengths of the pull and of the loss.
    """

    def __init__(self, model: TreeRCNN, settings: TrainSettings) -> None:
        spec = model.spec
        self._settings, self._backbones = settings, model.backbones
        forms = [(spec.backbone, spec.channels, spec.backbone_levels, spec.stride_in_1x1)]
        if spec.colour_backbone is not None:
            forms.append((spec.colour_backbone, 3, spec.colour_backbone_levels, False))
        self._starts = [Backbone(*form) for form in forms]
        for start, own in zip(self._starts, self._backbones, strict=True):
            start.load_state_dict(own.state_dict())
            start.to(next(model.parameters()).device).to(memory_format=torch.channels_last)
            start.requires_grad_(False).eval()
        self._seen: dict[int, tuple[Tensor, list[Tensor]]] = {}
        if settings.keep_features:
            for number, own in enumerate(self._backbones):
                own.register_forward_hook(partial(self._remember, number))

    def state(self) -> dict[str, Tensor]:
        """The starting weights, to go on with after an interruption."""
        return _joined(self._starts)

    def own_state(self) -> dict[str, Tensor]:
        """The model's weights now, in the form of `state`."""
        return _joined(self._backbones)

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Take the starting weights of an interrupted training."""
        first, *colour = self._starts
        first.load_state_dict({n: x for n, x in state.items() if not n.startswith(_COLOUR)})
        for start in colour:
            own = {n.removeprefix(_COLOUR): x for n, x in state.items() if n.startswith(_COLOUR)}
            start.load_state_dict(own)

    def _remember(
        self, number: int, module: nn.Module, inputs: tuple[Tensor], maps: list[Tensor]
    ) -> None:
        self._seen[number] = inputs[0], maps

    def loss(self, mean_count: CountReducer = local_count) -> dict[str, Tensor]:
        """The loss `features` of the last forward pass; empty without it.

        It is the mean over images and levels of the squared difference of an image's maps, divided
        by the variance of its starting map; 0 if no image shows anything.

        Args:
            mean_count: Mean of a count over the training processes, as some may have fewer images.
        """
        if not self._settings.keep_features:
            return {}
        parts: list[Tensor] = []
        for number, (images, maps) in sorted(self._seen.items()):
            with torch.no_grad():
                starts = self._starts[number](images)
            parts += [
                (own.float() - start.float()).square().flatten(1).mean(1)
                / start.float().flatten(1).var(1).clamp(min=_LEAST_VARIANCE)
                for own, start in zip(maps, starts, strict=True)
            ]
        self._seen = {}
        found = torch.cat(parts)
        count = mean_count(torch.tensor(len(found), device=found.device)).clamp(min=1)
        return {"features": self._settings.keep_features * found.sum() / count}

    def pull(self, rate: float) -> None:
        """Move the trained weights towards the starting ones after a step.

        Args:
            rate: Learning rate of the backbone in this step.
        """
        share = min(1.0, rate * self._settings.keep_weights)
        with torch.no_grad():
            for backbone, beginning in zip(self._backbones, self._starts, strict=True):
                for own, start in zip(backbone.parameters(), beginning.parameters(), strict=True):
                    if share and own.requires_grad:
                        own.lerp_(start, share)


def _joined(backbones: Iterable[nn.Module]) -> dict[str, Tensor]:
    """The tensors of the backbones by name."""
    first, *colour = (backbone.state_dict() for backbone in backbones)
    return first | {_COLOUR + name: x for state in colour for name, x in state.items()}
