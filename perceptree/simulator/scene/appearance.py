"""Colours and textures of the materials in a scene, natural or randomised."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from basetree.arrays import Float, Int64
from perceptree.simulator.materials.layers import Layer, is_cutout
from perceptree.simulator.settings import RandomisationSettings

_HUE_SHARE, _SKY_HUE_SHARE = 0.8, 0.35  # largest shift towards a random hue
_BRIGHTNESS = 0.5  # standard deviation of the logarithm of the brightness
_SOLID = np.array([layer for layer in Layer if not is_cutout(layer)])


@dataclass(frozen=True)
class Appearance:
    """Colours and textures of all layers.

    Attributes:
        texture_layer: (layers,) number of the layer whose texture each layer shows.
        gains: (layers, 3) factors of the layers' linear RGB colours.
        sky_gains: (3,) factors of the light's linear RGB colours.
    """

    texture_layer: Int64
    gains: Float
    sky_gains: Float

    @property
    def changed(self) -> bool:
        """Whether any material or the light differs from its natural appearance."""
        unlike = (self.gains != 1).any() or (self.sky_gains != 1).any()
        return bool(unlike or (self.texture_layer != np.arange(len(self.texture_layer))).any())


def natural_appearance() -> Appearance:
    """The natural appearance of all materials."""
    return Appearance(np.arange(len(Layer)), np.ones((len(Layer), 3)), np.ones(3))


def random_appearance(rng: np.random.Generator, settings: RandomisationSettings) -> Appearance:
    """Draw random colours and textures for some materials.

    A cut-out layer keeps its outline and takes the texture of a solid layer.

    Args:
        rng: Source of random numbers.
        settings: Probabilities of each change.
    """
    appearance = natural_appearance()
    for layer in Layer:
        if rng.random() < settings.recolour:
            appearance.gains[layer] = _random_gains(rng, _HUE_SHARE)
        if rng.random() < settings.swap:
            appearance.texture_layer[layer] = rng.choice(_SOLID)
    sky = (
        _random_gains(rng, _SKY_HUE_SHARE) if rng.random() < settings.sky else appearance.sky_gains
    )
    return Appearance(appearance.texture_layer, appearance.gains, sky)


def _random_gains(rng: np.random.Generator, most: float) -> Float:
    """(3,) factors that shift a colour by up to `most` towards a random hue, with brightness."""
    hue = rng.dirichlet(np.ones(3)) * 3
    pull = most * rng.random()
    return np.asarray((1 - pull + pull * hue) * np.exp(rng.normal(0, _BRIGHTNESS)))
