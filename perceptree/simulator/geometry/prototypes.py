"""Meshes shared by all scenes of a process: crowns near and far, and undergrowth by kind."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from perceptree.simulator.geometry.crowns import crown, dead_twigs, sapling
from perceptree.simulator.geometry.mesh import Mesh
from perceptree.simulator.geometry.objects import OBJECTS
from perceptree.simulator.geometry.undergrowth import LOW_PLANTS, UNDERGROWTH
from perceptree.simulator.scene.models import MODELS, TreeModel

_NEAR_CROWNS, _FAR_CROWNS = 2, 1
_FINE_SEED = 6
_TWIGS = (50, 100, 200, 350)
_SAPLINGS = ("fir", "fir", "spruce", "spruce")


@dataclass(frozen=True)
class Prototypes:
    """``crowns`` by model's name, near or far, in leaf or bare; ``undergrowth`` and objects by
    kind; ``twigs`` by the number of dead twigs on a lower stem."""

    crowns: dict[tuple[str, bool, bool], list[Mesh]]
    undergrowth: dict[str, list[Mesh]]
    twigs: dict[int, Mesh]

    def twigs_of(self, number: float) -> Mesh | None:
        """The mesh whose number of dead twigs comes nearest, None for hardly any."""
        if number < _TWIGS[0] / 2:
            return None
        return self.twigs[min(_TWIGS, key=lambda count: abs(count - number))]

    def crowns_of(
        self, model: TreeModel, near: bool, leaves: bool, fine: bool = False
    ) -> list[Mesh]:
        """The crowns a tree of this model may wear; conifers keep theirs in winter."""
        if near and fine:
            return _fine_crowns(model, leaves or model.conifer)
        return self.crowns[model.name, near, leaves or model.conifer]


@cache
def _fine_crowns(model: TreeModel, leaves: bool) -> list[Mesh]:
    """Crowns of fine twigs, grown when a scene first asks for them."""
    rng = np.random.default_rng([_FINE_SEED, MODELS.index(model)])
    return [crown(rng, model, True, leaves, fine=True) for _ in range(_NEAR_CROWNS)]


def make_prototypes(seed: int = 5) -> Prototypes:
    """Grow the shared meshes; the same seed gives the same meshes."""
    rng = np.random.default_rng(seed)
    crowns = {
        (model.name, near, leaves): [
            crown(rng, model, near, leaves) for _ in range(_NEAR_CROWNS if near else _FAR_CROWNS)
        ]
        for model in MODELS
        for near in (True, False)
        for leaves in ((True,) if model.conifer else (True, False))
    }
    undergrowth = {
        name: [kind.make(rng) for _ in range(kind.variants)] for name, kind in UNDERGROWTH.items()
    }
    undergrowth["sapling"] = [sapling(rng, species) for species in _SAPLINGS]
    later = np.random.default_rng([seed, 1])
    for name, kind in LOW_PLANTS.items():
        undergrowth[name] = [kind.make(later) for _ in range(kind.variants)]
    for name, (make, variants) in OBJECTS.items():
        undergrowth[name] = [make(later) for _ in range(variants)]
    return Prototypes(crowns, undergrowth, {count: dead_twigs(later, count) for count in _TWIGS})
