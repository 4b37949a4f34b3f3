"""Where stems spawn: density, pattern, and rules of altitude, slope and neighbours."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.scene.terrain import EXTENT_M, Terrain
from perceptree.simulator.settings import PATTERNS, StandSettings

Float = NDArray[np.floating[Any]]

_BORDER_M = 1.0
_OVERDRAW = 6
_CLUSTER_M = 3.2
_CLUSTER_STEMS = 7
_GRID_JITTER = 0.32


def stem_positions(
    rng: np.random.Generator,
    settings: StandSettings,
    terrain: Terrain,
    stems_per_ha: float,
    pattern: str,
) -> Float:
    """(n, 2) metres of the stems over the whole extent, n as near to the density as rules allow.

    Candidates of the pattern are taken in random order. One is refused where the ground is too
    steep, by chance where the altitude is not liked, and where it would stand too close to a stem
    or give itself or a stem too many neighbours.
    """
    half = EXTENT_M - _BORDER_M
    wanted = round(stems_per_ha / 1e4 * (2 * half) ** 2)
    candidates = _candidates(rng, pattern, wanted, half)
    liking = rng.uniform(*settings.altitude_preference)
    altitude = terrain.relative_altitude(*candidates.T)
    welcome = rng.random(len(candidates)) < 1 - abs(liking) + abs(liking) * 0.5 * (
        1 + np.sign(liking) * altitude
    )
    welcome &= terrain.local_slope_deg(*candidates.T) <= settings.max_slope_deg
    return _take(candidates[welcome], wanted, settings)


def _candidates(rng: np.random.Generator, pattern: str, wanted: int, half: float) -> Float:
    number = _OVERDRAW * wanted
    if pattern == PATTERNS[1]:
        spacing = 2 * half / np.sqrt(wanted)
        steps = np.arange(-half, half, spacing)
        grid = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
        rows = grid + rng.normal(0, _GRID_JITTER * spacing, grid.shape)
        gaps = rng.uniform(-half, half, (number - len(rows), 2))
        return np.asarray(np.clip(np.concatenate([rng.permutation(rows), gaps]), -half, half))
    if pattern == PATTERNS[2]:
        middles = rng.uniform(-half, half, (max(1, number // _CLUSTER_STEMS), 2))
        offsets = rng.normal(0, _CLUSTER_M / 2, (len(middles), _CLUSTER_STEMS, 2))
        return np.asarray(np.clip((middles[:, None] + offsets).reshape(-1, 2), -half, half))
    return np.asarray(rng.uniform(-half, half, (number, 2)))


def _take(candidates: Float, wanted: int, settings: StandSettings) -> Float:
    """The first ``wanted`` candidates that keep the distance and the number of neighbours."""
    kept = np.empty((wanted, 2))
    neighbours = np.zeros(wanted, int)
    count = 0
    for point in candidates:
        if count == wanted:
            break
        distance = np.hypot(*(kept[:count] - point).T)
        if count and distance.min() < settings.spacing_m:
            continue
        close = np.nonzero(distance < settings.neighbour_radius_m)[0]
        if (
            len(close) > settings.max_neighbours
            or (neighbours[close] >= settings.max_neighbours).any()
        ):
            continue
        kept[count] = point
        neighbours[close] += 1
        neighbours[count] = len(close)
        count += 1
    return kept[:count]
