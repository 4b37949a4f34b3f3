"""Meshes shared by all scenes of a process: crowns near and far, and undergrowth by kind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from perceptree.simulator.geometry.crowns import crown, sapling
from perceptree.simulator.geometry.mesh import Mesh
from perceptree.simulator.geometry.undergrowth import UNDERGROWTH
from perceptree.simulator.scene.models import MODELS, TreeModel

_NEAR_CROWNS, _FAR_CROWNS = 2, 1
_SAPLINGS = ("fir", "fir", "spruce", "spruce")


@dataclass(frozen=True)
class Prototypes:
    """``crowns`` by model's name, near or far, in leaf or bare; ``undergrowth`` by kind."""

    crowns: dict[tuple[str, bool, bool], list[Mesh]]
    undergrowth: dict[str, list[Mesh]]

    def crowns_of(self, model: TreeModel, near: bool, leaves: bool) -> list[Mesh]:
        """The crowns a tree of this model may wear; conifers keep theirs in winter."""
        return self.crowns[model.name, near, leaves or model.conifer]


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
    return Prototypes(crowns, undergrowth)
