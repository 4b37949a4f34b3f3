"""The streams of random numbers that decide a scene: one for each purpose, so that what is drawn
for one changes no other."""

from __future__ import annotations

from enum import IntEnum, unique

import numpy as np


@unique
class Stream(IntEnum):
    """What random numbers are for. A number decides bytes of data sets: it is never changed."""

    SCENE = 1
    VIEW = 2
    ADDITIONS = 3
    FAULTS = 4
    CIRCUIT = 5
    DEATH = 6
    SENSORS = 7
    DRIVE = 8


def stream(seed: int, purpose: Stream, *numbers: int) -> np.random.Generator:
    """Random numbers for a purpose in the scene of a seed, say of its view ``numbers``."""
    return np.random.default_rng([seed, int(purpose), *numbers])
