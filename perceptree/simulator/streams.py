"""Random number streams of a scene, one per purpose.

With separate streams, a change in the number of draws for one purpose affects no other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import IntEnum, unique

import numpy as np


@unique
class Stream(IntEnum):
    """Purposes of random numbers. The values are part of the seeds and must never change."""

    SCENE = 1
    VIEW = 2
    ADDITIONS = 3
    FAULTS = 4
    CIRCUIT = 5
    DEATH = 6
    SENSORS = 7
    DRIVE = 8
    VEGETATION = 9
    PHOTOGRAPHS = 10
    NIGHT = 11
    TRAP = 12
    NEGATIVES = 13


def choose(rng: np.random.Generator, weights: Mapping[str, float], known: Sequence[str]) -> str:
    """Choose one of the known names by their weights; a name without weight is never chosen."""
    shares = np.array([weights.get(name, 0.0) for name in known])
    return known[rng.choice(len(known), p=shares / shares.sum())]


def stream(seed: int, purpose: Stream, *numbers: int) -> np.random.Generator:
    """Make the random number generator for one purpose in a scene.

    Args:
        seed: Seed of the scene.
        purpose: What the numbers are for.
        *numbers: Further parts of the seed, such as the number of the view.
    """
    return np.random.default_rng([seed, int(purpose), *numbers])
