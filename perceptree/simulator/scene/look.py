"""Which colours and textures the materials of a scene wear."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.materials.layers import Layer, is_cutout
from perceptree.simulator.settings import RandomisationSettings

Float = NDArray[np.floating[Any]]

_HUE_SHARE, _SKY_HUE_SHARE = 0.8, 0.35
_BRIGHTNESS = 0.5
_SOLID = np.array([layer for layer in Layer if not is_cutout(layer)])


@dataclass(frozen=True)
class Look:
    """Colours and textures of all layers.

    ``worn`` (layers,) is the number of the layer whose texture each layer shows; ``gains``
    (layers, 3) multiply its linear RGB colour. ``sky_gains`` (3,) multiply the light's colour.
    """

    worn: NDArray[np.int64]
    gains: Float
    sky_gains: Float

    @property
    def changed(self) -> bool:
        """Whether any material or the light is other than natural."""
        unlike = (self.gains != 1).any() or (self.sky_gains != 1).any()
        return bool(unlike or (self.worn != np.arange(len(self.worn))).any())


def natural_look() -> Look:
    """Every material as it is."""
    return Look(np.arange(len(Layer)), np.ones((len(Layer), 3)), np.ones(3))


def random_look(rng: np.random.Generator, settings: RandomisationSettings) -> Look:
    """Colours and textures by chance; a cut-out keeps its outline and takes a solid's texture."""
    look = natural_look()
    for layer in Layer:
        if rng.random() < settings.recolour:
            look.gains[layer] = _random_gains(rng, _HUE_SHARE)
        if rng.random() < settings.swap:
            look.worn[layer] = rng.choice(_SOLID)
    sky = _random_gains(rng, _SKY_HUE_SHARE) if rng.random() < settings.sky else look.sky_gains
    return Look(look.worn, look.gains, sky)


def _random_gains(rng: np.random.Generator, most: float) -> Float:
    """(3,) gains towards any hue by up to ``most``, brighter or darker."""
    hue = rng.dirichlet(np.ones(3)) * 3
    pull = most * rng.random()
    return np.asarray((1 - pull + pull * hue) * np.exp(rng.normal(0, _BRIGHTNESS)))
