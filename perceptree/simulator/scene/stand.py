"""Positions of stems: density, spatial pattern, and limits on slope, altitude and neighbours."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.scene.terrain import EXTENT_M, Terrain
from perceptree.simulator.settings import PATTERNS, StandSettings

_BORDER_M = 1.0  # border of the terrain without stems
_OVERDRAW = 6  # candidates per requested stem
_CLUSTER_M = 3.2  # two standard deviations of the stems about the centre of their cluster
_CLUSTER_STEMS = 7
_GRID_JITTER = 0.32  # standard deviation of stems in a regular stand, over their spacing


def stem_positions(
    rng: np.random.Generator,
    settings: StandSettings,
    terrain: Terrain,
    stems_per_ha: float,
    pattern: str,
) -> Float:
    """Draw the positions of the stems over the whole terrain.

    Candidates are drawn by the pattern. A candidate is rejected if the ground is too steep, at
    random by altitude preference, if it is too close to another stem, or if it or another stem
    would have too many neighbours. The density can therefore be lower than requested.

    Args:
        rng: Source of random numbers.
        settings: Limits.
        terrain: The ground.
        stems_per_ha: Requested density.
        pattern: One of PATTERNS.

    Returns:
        (n, 2) positions, m.
    """
    half = EXTENT_M - _BORDER_M
    target_count = round(stems_per_ha / 1e4 * (2 * half) ** 2)
    candidates = _candidates(rng, pattern, target_count, half)
    preference = rng.uniform(*settings.altitude_preference)
    altitude = terrain.relative_altitude(*candidates.T)
    accepted = rng.random(len(candidates)) < 1 - abs(preference) + abs(preference) * 0.5 * (
        1 + np.sign(preference) * altitude
    )
    accepted &= terrain.local_slope_deg(*candidates.T) <= settings.max_slope_deg
    return _select_spaced(candidates[accepted], target_count, settings)


def _candidates(rng: np.random.Generator, pattern: str, target_count: int, half: float) -> Float:
    number = _OVERDRAW * target_count
    if pattern == PATTERNS[1]:
        spacing = 2 * half / np.sqrt(target_count)
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


def _select_spaced(candidates: Float, target_count: int, settings: StandSettings) -> Float:
    """Select the first candidates that keep the distance and the number of neighbours."""
    kept = np.empty((target_count, 2))
    neighbours = np.zeros(target_count, int)
    count = 0
    for point in candidates:
        if count == target_count:
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
