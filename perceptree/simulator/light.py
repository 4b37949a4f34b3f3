"""Daylight: sun, sky and haze of a scene, and how much sky the canopy leaves each point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.settings import LightSettings
from perceptree.simulator.terrain import EXTENT_M
from perceptree.simulator.textures import Layer

Float = NDArray[np.floating[Any]]

_VOXEL_M = 1.0
_LEAF_EXTINCTION = 0.55
_LEAF_COVER = 0.45


@dataclass(frozen=True)
class Light:
    """``sun`` (3,) unit vector towards it; colours (3,) linear RGB; haze per metre of path."""

    sun: Float
    sun_colour: Float
    sky_colour: Float
    haze_colour: Float
    haze_per_m: float


def make_light(rng: np.random.Generator, settings: LightSettings) -> Light:
    """Draw a daylight: the lower the sun, the warmer and weaker its light."""
    elevation = np.radians(rng.uniform(*settings.sun_elevation_deg))
    azimuth = rng.uniform(0, 2 * np.pi)
    across = np.cos(elevation)
    sun = np.array([across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)])
    strength = rng.uniform(*settings.sun_strength)
    warmth = 1 - np.sin(elevation)
    sun_colour = strength * np.array([1.0, 0.90 - 0.12 * warmth, 0.74 - 0.25 * warmth])
    sky_colour = np.array([0.52, 0.63, 0.80]) * rng.uniform(0.85, 1.2)
    haze_colour = np.array([0.10, 0.115, 0.115]) * rng.uniform(0.8, 2.2)
    return Light(sun, sun_colour, sky_colour, haze_colour, rng.uniform(*settings.haze_per_m))


def _blur(layer: Float) -> Float:
    padded = np.pad(layer, 1, "edge")
    rows = (padded[:-2] + 2 * padded[1:-1] + padded[2:]) / 4
    return np.asarray((rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:]) / 4)


def sky_visibility(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], layer: NDArray[np.uint8]
) -> NDArray[np.float32]:
    """(V,) share of sky that reaches each vertex through the canopy.

    Leaf area is summed in voxels from the top down with a blur per layer, and light falls off
    with it exponentially (Beer and Lambert).
    """
    leaf = faces[(layer == Layer.FIR_TWIG) | (layer == Layer.LEAVES)]
    corner = vertices[leaf[:, 0]]
    edges = vertices[leaf[:, 1]] - corner, vertices[leaf[:, 2]] - corner
    area = np.linalg.norm(np.cross(*edges), axis=1) * 0.5 * _LEAF_COVER
    across = int(2 * EXTENT_M / _VOXEL_M)
    origin = np.array([-EXTENT_M, -EXTENT_M, vertices[:, 2].min()])
    up = int((vertices[:, 2].max() - origin[2]) / _VOXEL_M) + 2
    highest = np.array([across, across, up])
    x, y, z = np.clip(((corner - origin) / _VOXEL_M).astype(int), 0, highest - 1).T
    density = np.bincount((z * across + y) * across + x, area, up * across * across)
    density = density.reshape(up, across, across)
    shade = np.zeros_like(density)
    above: Float = np.zeros((across, across))
    for level in range(up - 1, -1, -1):
        shade[level] = above + 0.5 * density[level]
        above = _blur(above + density[level])
    open_sky = np.exp(-_LEAF_EXTINCTION * shade).astype(np.float32)
    place = np.clip((vertices - origin) / _VOXEL_M - 0.5, 0, highest - 1.001).astype(np.float32)
    low = place.astype(np.int32)
    rest = place - low
    visible = np.zeros(len(vertices), np.float32)
    for dz in (0, 1):
        for dy in (0, 1):
            for dx in (0, 1):
                share = np.abs(np.array([1 - dx, 1 - dy, 1 - dz], np.float32) - rest)
                weight = share[:, 0] * share[:, 1] * share[:, 2]
                visible += weight * open_sky[low[:, 2] + dz, low[:, 1] + dy, low[:, 0] + dx]
    return np.float32(0.1) + np.float32(0.9) * visible
