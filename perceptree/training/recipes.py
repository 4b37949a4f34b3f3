"""Named training settings."""

from __future__ import annotations

from typing import Any

from basetree.errors import SettingsError
from perceptree.settings.augmentation import PAPER_AUGMENT, VARIED_AUGMENT
from perceptree.settings.sampling import PAPER_SAMPLING
from perceptree.settings.training import TrainSettings

RECIPES: dict[str, dict[str, Any]] = {
    "scratch": {},
    "varied": {"augment": VARIED_AUGMENT},
    "transfer": {
        "augment": VARIED_AUGMENT,
        "learning_rate": 0.002,
        "schedule": "decay",
        "freeze_level": 2,
        "frozen_norms": True,
        "keep_features": 1.0,
    },
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
"""Differences from the defaults of TrainSettings, by name.

`scratch` is for light networks with random weights. `varied` is the same with stronger changes
of light, tone, colour and sharpness, for RGB models that will see real cameras. `transfer` adds
what keeps a pretrained backbone from forgetting real pictures while it learns simulated ones: its
first stages and norms are frozen, and its maps are held near those of the starting weights; the
rate falls to a hundredth. `paper` follows
Grondin et al. (2022) and their published configurations, in which training takes 60,000 steps and
starts from COCO or ImageNet weights with FREEZE_AT 2 and fixed batch norms.
"""

PAPER_STEPS = 60_000
"""Training steps of Grondin et al. (2022)."""

PAPER_FREEZING = {"freeze_level": 2, "frozen_norms": True}
"""What Grondin et al. (2022) keep fixed where training starts from published weights."""


def recipe_settings(name: str, **changes: Any) -> TrainSettings:
    """Make the training settings of a recipe.

    Args:
        name: A key of `RECIPES`.
        **changes: Fields of TrainSettings; one of `steps` and `minutes` is required.

    Raises:
        SettingsError: If the recipe is unknown or a value is out of range.

    Examples:
        >>> from perceptree.training import recipe_settings
        >>> recipe_settings("scratch", steps=1000).batch
        8
    """
    if name not in RECIPES:
        raise SettingsError(f"recipe is {name!r}: expected one of {', '.join(RECIPES)}")
    return TrainSettings(**RECIPES[name] | changes)
