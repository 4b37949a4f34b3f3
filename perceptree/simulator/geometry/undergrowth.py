"""Kinds of undergrowth, by the names that scene descriptions use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from perceptree.simulator.geometry import debris, plants
from perceptree.simulator.geometry.mesh import Mesh


@dataclass(frozen=True)
class UndergrowthKind:
    """A kind of undergrowth.

    Attributes:
        make: Makes one variant, which stands on z = 0.
        variants: Number of variants that scenes choose from.
    """

    make: Callable[[np.random.Generator], Mesh]
    variants: int


UNDERGROWTH: dict[str, UndergrowthKind] = {
    "grass": UndergrowthKind(plants.grass_tuft, 6),
    "dry_grass": UndergrowthKind(plants.dry_grass, 5),
    "fern": UndergrowthKind(plants.fern, 5),
    "scrub": UndergrowthKind(plants.scrub, 5),
    "seedling": UndergrowthKind(plants.seedling, 4),
    "branch": UndergrowthKind(debris.fallen_branch, 12),
    "log": UndergrowthKind(debris.log, 6),
    "stump": UndergrowthKind(debris.stump, 8),
    "rock": UndergrowthKind(debris.rock, 8),
    "root": UndergrowthKind(debris.surface_roots, 8),
}

LOW_PLANTS: dict[str, UndergrowthKind] = {
    "herb": UndergrowthKind(plants.herb, 6),
    "bilberry": UndergrowthKind(plants.bilberry, 6),
}
