"""Dense low plants on the ground, and clutter around the feet of stems."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.scene.scatter import RADIUS_M, Placement, place
from perceptree.simulator.scene.terrain import Terrain
from perceptree.simulator.settings import ClutterSettings
from perceptree.simulator.vectors import heading

# Kind: field of ClutterSettings, number of plants at full density, spatial frequency of patches.
_GROUND_PLANTS = {"herb": ("herbs", 5200, 0.30), "bilberry": ("shrubs", 2600, 0.42)}
_FOOT_PLANTS = ("grass", "fern", "herb", "bilberry", "scrub", "seedling", "branch", "rock", "stump")
_TINT = (0.7, 1.2)  # range of the brightness factor
_FOOT_REACH_M = (0.02, 0.35)  # range of the distance from the bark


def cover_ground(
    rng: np.random.Generator, settings: ClutterSettings, terrain: Terrain
) -> list[Placement]:
    """Scatter herbs and dwarf shrubs in patches, denser towards the scene's centre.

    Args:
        rng: Source of random numbers.
        settings: Densities.
        terrain: The ground.
    """
    placements = []
    for kind, (setting, full_count, patch) in _GROUND_PLANTS.items():
        density = rng.uniform(*getattr(settings, setting))
        number = int(full_count * density)
        distance, angle = RADIUS_M * rng.random(number) ** 0.6, rng.uniform(0, 2 * np.pi, number)
        places_m = distance[:, None] * heading(angle)
        x, y = places_m.T
        phase = rng.uniform(0, 2 * np.pi, 2)
        wave = np.sin(patch * x + phase[0]) * np.cos(patch * 1.3 * y + phase[1])
        kept = wave + rng.normal(0, 0.3, number) > 0.6 - 1.4 * density
        placements.append(place(rng, kind, terrain, places_m[kept], (0.6, 1.5), _TINT))
    return placements


def surround_feet(
    rng: np.random.Generator,
    settings: ClutterSettings,
    terrain: Terrain,
    feet_m: Float,
    radii_m: Float,
) -> list[Placement]:
    """Place plants, branches, stones and stumps around the feet of some stems.

    Args:
        rng: Source of random numbers.
        settings: Fraction of the stems.
        terrain: The ground.
        feet_m: (n, 2) positions of the stems, m.
        radii_m: (n,) radii of the stems, m.
    """
    share = rng.uniform(*settings.foot)
    chosen = np.nonzero(rng.random(len(feet_m)) < share)[0]
    stems = np.repeat(chosen, rng.integers(2, 9, len(chosen)))
    gap_m = radii_m[stems] + rng.uniform(*_FOOT_REACH_M, len(stems))
    angle = rng.uniform(0, 2 * np.pi, len(stems))
    positions = feet_m[stems] + gap_m[:, None] * heading(angle)
    weights = np.array([4, 3, 4, 3, 2, 1, 2, 1, 0.3])
    kinds = rng.choice(len(_FOOT_PLANTS), len(stems), p=weights / weights.sum())
    return [
        place(rng, kind, terrain, positions[kinds == number], (0.5, 1.1), _TINT)
        for number, kind in enumerate(_FOOT_PLANTS)
    ]
