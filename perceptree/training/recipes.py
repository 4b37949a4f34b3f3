"""Ways to train, by name."""

from __future__ import annotations

from typing import Any

from perceptree.data import PAPER_AUGMENT
from perceptree.errors import SettingsError
from perceptree.models import PAPER_SAMPLING
from perceptree.training.settings import TrainSettings

RECIPES: dict[str, dict[str, Any]] = {
    "scratch": {},
    "paper": {
        "batch": 8,
        "optimizer": "sgd",
        "learning_rate": 0.002,
        "schedule": "steps",
        "rate_steps": (10_000, 30_000),
        "weight_decay": 0.0005,
        "warmup_steps": 1000,
        "clip_norm": None,
        "ema_decay": 0.0,
        "evaluate_every_steps": 2000,
        "augment": PAPER_AUGMENT,
        "sampling": PAPER_SAMPLING,
    },
}
"""What differs from the defaults of TrainSettings.

``scratch`` is for light networks from random weights. ``paper`` is Grondin et al. (2022) with
what their published configurations add: 60,000 steps, from COCO's or ImageNet's weights, with
FREEZE_AT 2 and fixed batch norms.
"""

PAPER_STEPS = 60_000


def recipe_settings(name: str, **changes: Any) -> TrainSettings:
    """The settings of a recipe with ``changes``; steps or minutes are among them.

    Raises SettingsError for a name that no recipe has, or values out of range.
    """
    if name not in RECIPES:
        raise SettingsError(f"recipe is {name!r}: expected one of {', '.join(RECIPES)}")
    return TrainSettings(**RECIPES[name] | changes)
