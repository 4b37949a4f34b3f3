"""How a detector is trained: one frozen, checked dataclass, stored in the checkpoint."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

from perceptree.data import AugmentSettings
from perceptree.errors import SettingsError
from perceptree.models import SampleSettings

_POSITIVE = (
    "steps", "minutes", "batch", "learning_rate", "warmup_steps", "clip_norm", "evaluations",
    "save_every_steps",
)  # fmt: skip
_LAST_LEVEL = 5  # of a backbone


@dataclass(frozen=True)
class TrainSettings:
    """Training ends after ``steps`` or ``minutes`` of training time, one of the two.

    The learning rate warms up over ``warmup_steps``, then falls along a cosine to
    ``final_rate_share`` of its peak. Weights are averaged with ``ema_decay`` per step. Of the
    backbone, the parts up to the maps of stride ``2**freeze_level`` stay as they are (0: none, 2:
    Detectron2's FREEZE_AT 2), and with ``frozen_norms`` all of its batch norms.
    """

    steps: int | None = None
    minutes: float | None = None
    batch: int = 8
    learning_rate: float = 1.5e-3
    final_rate_share: float = 0.01
    weight_decay: float = 0.05
    warmup_steps: int = 150
    clip_norm: float = 10.0
    ema_decay: float = 0.998
    evaluations: int = 4
    save_every_steps: int = 200
    seed: int = 0
    freeze_level: int = 0
    frozen_norms: bool = False
    augment: AugmentSettings = field(default_factory=AugmentSettings)
    sampling: SampleSettings = field(default_factory=SampleSettings)

    def __post_init__(self) -> None:
        if (self.steps is None) == (self.minutes is None):
            raise SettingsError(
                f"steps is {self.steps} and minutes {self.minutes}: expected exactly one of them"
            )
        for name in _POSITIVE:
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise SettingsError(f"{name} is {value}: expected more than 0")
        if not (math.isfinite(self.weight_decay) and self.weight_decay >= 0):
            raise SettingsError(f"weight_decay is {self.weight_decay}: expected at least 0")
        if not 0 <= self.final_rate_share <= 1:
            raise SettingsError(f"final_rate_share is {self.final_rate_share}: expected 0 to 1")
        if not 0 <= self.ema_decay < 1:
            raise SettingsError(f"ema_decay is {self.ema_decay}: expected at least 0, under 1")
        if not 0 <= self.freeze_level <= _LAST_LEVEL:
            raise SettingsError(f"freeze_level is {self.freeze_level}: expected 0 to {_LAST_LEVEL}")
        if self.seed < 0:
            raise SettingsError(f"seed is {self.seed}: expected at least 0")

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return dataclasses.asdict(self)
