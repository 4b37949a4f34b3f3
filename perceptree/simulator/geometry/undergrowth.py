"""The kinds of undergrowth, by the name under which a scene places them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from perceptree.simulator.geometry import debris, plants
from perceptree.simulator.geometry.mesh import Mesh


@dataclass(frozen=True)
class Kind:
    """How one object is made, standing on z = 0, and how many forms of it scenes choose from."""

    make: Callable[[np.random.Generator], Mesh]
    variants: int


UNDERGROWTH: dict[str, Kind] = {
    "grass": Kind(plants.grass_tuft, 6),
    "dry_grass": Kind(plants.dry_grass, 5),
    "fern": Kind(plants.fern, 5),
    "scrub": Kind(plants.scrub, 5),
    "seedling": Kind(plants.seedling, 4),
    "branch": Kind(debris.fallen_branch, 12),
    "log": Kind(debris.log, 6),
    "stump": Kind(debris.stump, 8),
    "rock": Kind(debris.rock, 8),
    "root": Kind(debris.surface_roots, 8),
}

LOW_PLANTS: dict[str, Kind] = {
    "herb": Kind(plants.herb, 6),
    "bilberry": Kind(plants.bilberry, 6),
}
