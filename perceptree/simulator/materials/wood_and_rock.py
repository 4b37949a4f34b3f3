"""Textures of rock, weathered wood and cut wood."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.materials.drawing import mix, noise, rgb
from perceptree.simulator.materials.layers import SIZE_PX, Layer
from perceptree.simulator.materials.noise import smoothstep

_RINGS = 34
_BARK_RADIUS = 0.46


def wood_and_rock_layers(rng: np.random.Generator) -> dict[Layer, tuple[Float, Float]]:
    """Draw the textures: colour (H, W, 3) and relief (H, W) by layer.

    All but the cut wood are seamless.
    """
    return {
        Layer.DEAD_WOOD: _dead_wood(rng),
        Layer.CUT_WOOD: _cut_wood(rng),
        Layer.ROCK: _rock(rng),
    }


def _rock(rng: np.random.Generator) -> tuple[Float, Float]:
    """Grey granite: grains of dark and light minerals, cracks and lichen."""
    grain, medium, broad = noise(rng, 0.4), noise(rng, 2.0), noise(rng, 2.8)
    colour = mix(rgb(74, 72, 69), rgb(118, 115, 110), smoothstep(-1.8, 1.8, medium))
    colour = mix(colour, rgb(58, 56, 54), 0.5 * smoothstep(1.1, 1.7, grain))
    colour = mix(colour, rgb(146, 141, 134), 0.35 * smoothstep(1.0, 1.7, -grain))
    crack = 1 - smoothstep(0.015, 0.075, np.abs(noise(rng, 3.0) + 0.05 * medium))
    colour = mix(colour, rgb(44, 42, 40), 0.75 * crack)
    crust = smoothstep(0.85, 1.05, noise(rng, 1.9) + 0.18 * grain)
    colour = mix(colour, rgb(136, 141, 124), 0.75 * crust)
    yellow = smoothstep(1.55, 1.75, noise(rng, 1.9) + 0.2 * grain)
    colour = mix(colour, rgb(124, 118, 70), 0.7 * yellow)
    green = smoothstep(1.1, 1.8, broad + 0.2 * medium)
    colour = mix(colour, rgb(76, 84, 46), 0.7 * green)
    relief = 0.15 * grain + 1.6 * medium + 2.5 * broad - 2.5 * crack + 0.5 * crust
    return colour, relief


def _dead_wood(rng: np.random.Generator) -> tuple[Float, Float]:
    """Weathered wood without bark, with grain and cracks along v."""
    grain, fibre, broad = noise(rng, 1.6, 14.0, 1.0), noise(rng, 0.8, 20.0, 1.0), noise(rng, 2.2)
    tone = smoothstep(-2.0, 2.0, grain + 0.6 * fibre)
    colour = mix(rgb(78, 68, 57), rgb(142, 132, 118), tone)
    colour = mix(colour, rgb(104, 78, 56), 0.6 * smoothstep(0.4, 1.5, broad))
    crack = smoothstep(1.55, 2.1, noise(rng, 1.3, 12.0, 1.0))
    colour = mix(colour, rgb(38, 32, 27), 0.85 * crack)
    growth = smoothstep(1.5, 2.1, noise(rng, 1.8) + 0.2 * fibre)
    colour = mix(colour, rgb(112, 116, 92), 0.6 * growth)
    return colour, 0.9 * grain + 0.35 * fibre - 2.2 * crack + 0.3 * broad


def _cut_wood(rng: np.random.Generator) -> tuple[Float, Float]:
    """A sawn surface inside bark: growth rings, dark heartwood, cracks and saw marks."""
    position = (np.arange(SIZE_PX) + 0.5) / SIZE_PX - 0.5
    across, along = position[None], position[:, None]
    radius, angle = np.hypot(along, across), np.arctan2(along, across)
    wobble = 0.006 * noise(rng, 3.2) + 0.012 * radius / 0.5 * np.cos(2 * angle + rng.uniform(0, 6))
    ring_edges = np.cumsum(rng.uniform(0.5, 1.6, _RINGS))
    age = np.interp(radius + wobble, _BARK_RADIUS * ring_edges / ring_edges[-1], np.arange(_RINGS))
    season = (age % 1.0) ** 3
    fine = noise(rng, 1.2)
    colour = mix(rgb(194, 158, 112), rgb(132, 92, 58), 0.8 * season)
    heart = 1 - smoothstep(0.13, 0.20, radius + wobble)
    colour = mix(colour, colour * rgb(222, 196, 176), 0.9 * heart)
    colour = colour * (1 + 0.05 * noise(rng, 2.0)[..., None] + 0.02 * fine[..., None])
    saw = np.sin(2 * np.pi * (17 * across + 3 * along) + 0.6 * fine)
    crack = _cracks(rng, radius, angle, noise(rng, 2.4))
    colour = mix(colour * (1 + 0.035 * saw[..., None]), rgb(58, 40, 28), 0.9 * crack)
    colour = mix(colour, rgb(70, 54, 42), smoothstep(_BARK_RADIUS - 0.008, _BARK_RADIUS, radius))
    return colour, 0.5 * season + 0.15 * saw + 0.05 * fine - 1.5 * crack


def _cracks(rng: np.random.Generator, radius: Float, angle_rad: Float, bend: Float) -> Float:
    """Drying cracks of different lengths, widest at the bark, and one through the centre."""
    total = np.zeros_like(radius)
    for _ in range(6):
        away = angle_rad - rng.uniform(-np.pi, np.pi)
        offset = np.abs((away + np.pi) % (2 * np.pi) - np.pi) * radius + 0.004 * bend
        width = 0.010 * np.clip((radius - rng.uniform(0.05, 0.38)) / 0.4, 0, 1)
        total = np.maximum(total, smoothstep(0.0, 0.002, width - np.abs(offset)))
    heart = np.abs(np.sin(angle_rad - rng.uniform(0, np.pi)) * radius + 0.003 * bend)
    return np.maximum(total, (1 - smoothstep(0.001, 0.004, heart)) * (radius < 0.07))
