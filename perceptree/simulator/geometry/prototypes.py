"""Meshes that all scenes share: crowns, undergrowth, objects and dead twigs.

Scene descriptions use the names of the kinds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from perceptree.simulator.geometry import debris, plants
from perceptree.simulator.geometry.crowns import crown, dead_twigs, sapling
from perceptree.simulator.geometry.mesh import Kind, Mesh
from perceptree.simulator.geometry.negatives import NEGATIVES
from perceptree.simulator.geometry.objects import OBJECTS
from perceptree.simulator.geometry.vegetation import VEGETATION
from perceptree.simulator.scene.models import MODELS, TreeModel

_NEAR_CROWNS, _FAR_CROWNS = 2, 1
_FINE_SEED = 6
_DEAD_TWIG_COUNTS = (50, 100, 200, 350)
_SAPLINGS = ("fir", "fir", "spruce", "spruce")

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


@dataclass(frozen=True)
class Prototypes:
    """Shared meshes.

    Attributes:
        crowns: Variants by model name, near (or far), and with leaves (or bare).
        undergrowth: Variants of undergrowth, vegetation and objects by kind.
        twigs: Dead twigs of a lower stem, by their number.
    """

    crowns: dict[tuple[str, bool, bool], list[Mesh]]
    undergrowth: dict[str, list[Mesh]]
    twigs: dict[int, Mesh]

    def twigs_of(self, number: float) -> Mesh | None:
        """Return the mesh with the nearest number of dead twigs; None if there are almost none."""
        if number < _DEAD_TWIG_COUNTS[0] / 2:
            return None
        return self.twigs[min(_DEAD_TWIG_COUNTS, key=lambda count: abs(count - number))]

    def crowns_of(
        self, model: TreeModel, near: bool, leaves: bool, fine: bool = False
    ) -> list[Mesh]:
        """Return the crown variants of a tree model; those of conifers always have needles.

        Args:
            model: The tree model.
            near: Whether the tree is near.
            leaves: Whether broadleaved trees have leaves.
            fine: Whether near crowns have fine twigs.
        """
        if near and fine:
            return _fine_crowns(model, leaves or model.conifer)
        return self.crowns[model.name, near, leaves or model.conifer]


@cache
def _fine_crowns(model: TreeModel, leaves: bool) -> list[Mesh]:
    """Crowns with fine twigs, made when a scene first needs them."""
    rng = np.random.default_rng([_FINE_SEED, MODELS.index(model)])
    return [crown(rng, model, True, leaves, fine=True) for _ in range(_NEAR_CROWNS)]


def make_prototypes(seed: int = 5) -> Prototypes:
    """Make the shared meshes. The same seed gives the same meshes."""
    rng = np.random.default_rng(seed)
    crowns = {
        (model.name, near, leaves): [
            crown(rng, model, near, leaves) for _ in range(_NEAR_CROWNS if near else _FAR_CROWNS)
        ]
        for model in MODELS
        for near in (True, False)
        for leaves in ((True,) if model.conifer else (True, False))
    }
    undergrowth = _variants(rng, UNDERGROWTH)
    undergrowth["sapling"] = [sapling(rng, species) for species in _SAPLINGS]
    additions_rng, vegetation_rng, negatives_rng = (
        np.random.default_rng([seed, number]) for number in (1, 2, 3)
    )
    undergrowth |= _variants(additions_rng, LOW_PLANTS | OBJECTS)
    twigs = {count: dead_twigs(additions_rng, count) for count in _DEAD_TWIG_COUNTS}
    undergrowth |= _variants(vegetation_rng, VEGETATION) | _variants(negatives_rng, NEGATIVES)
    return Prototypes(crowns, undergrowth, twigs)


def _variants(rng: np.random.Generator, kinds: dict[str, Kind]) -> dict[str, list[Mesh]]:
    """Make the variants of each kind."""
    return {name: [kind.make(rng) for _ in range(kind.variants)] for name, kind in kinds.items()}
