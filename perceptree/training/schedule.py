"""Learning rate schedules."""

from __future__ import annotations

import math

from perceptree.settings.training import TrainSettings


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
