"""Stems and terrain: density, patterns and placement rules follow the settings."""

import dataclasses

import numpy as np
import pytest

from perceptree.simulator.scene.stand import stem_positions
from perceptree.simulator.scene.terrain import EXTENT_M, Terrain, make_terrain
from perceptree.simulator.settings import StandSettings, TerrainSettings

FREE = StandSettings(spacing_m=0.3, max_neighbours=100, altitude_preference=(0.0, 0.0))


def terrain(**settings) -> Terrain:
    return make_terrain(np.random.default_rng(5), TerrainSettings(**settings))


FLAT = terrain(slope_deg=(0.0, 0.0))


def stems(pattern: str, stand: StandSettings = FREE, per_ha: float = 600.0, on: Terrain = FLAT):
    return stem_positions(np.random.default_rng(3), stand, on, per_ha, pattern)


def nearest_m(points) -> np.ndarray:
    gaps = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    return np.sort(gaps, 1)[:, 1]


@pytest.mark.parametrize("pattern", ["random", "regular", "clustered"])
@pytest.mark.parametrize("per_ha", [200.0, 600.0, 1200.0])
def test_the_stand_has_the_stems_per_hectare_asked_for(pattern: str, per_ha: float):
    points = stems(pattern, per_ha=per_ha)
    assert np.abs(points).max() <= EXTENT_M
    hectares = (2 * (EXTENT_M - 1)) ** 2 / 1e4
    assert len(points) / hectares == pytest.approx(per_ha, rel=0.01)


def test_patterns_differ_as_their_names_say():
    """Index of Clark and Evans (1954): mean nearest distance over 0.5 / sqrt(density)."""

    def index(pattern: str) -> float:
        points = stems(pattern)
        return float(nearest_m(points).mean() * 2 * np.sqrt(600 / 1e4))

    assert index("random") == pytest.approx(1.05, abs=0.12)
    assert index("regular") > 1.25
    assert index("clustered") < 0.8


def test_no_stem_stands_closer_or_has_more_neighbours_than_set():
    stand = dataclasses.replace(FREE, spacing_m=1.5, neighbour_radius_m=3.0, max_neighbours=2)
    points = stems("clustered", stand, per_ha=900.0)
    gaps = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    assert nearest_m(points).min() >= 1.5
    assert ((gaps < 3.0).sum(1) - 1).max() <= 2
    assert ((gaps < 3.0).sum(1) - 1).max() == 2


def test_an_altitude_preference_moves_the_stand_up_or_down():
    hilly = terrain(slope_deg=(10.0, 10.0), relief_m=(1.0, 1.0))

    def altitude(preference: float) -> float:
        stand = dataclasses.replace(FREE, altitude_preference=(preference, preference))
        return float(hilly.relative_altitude(*stems("random", stand, on=hilly).T).mean())

    assert altitude(-1.0) < altitude(0.0) - 0.05
    assert altitude(1.0) > altitude(0.0) + 0.05


def test_ground_that_is_too_steep_stays_bare():
    rough = terrain(slope_deg=(15.0, 15.0), relief_m=(1.5, 1.5))
    stand = dataclasses.replace(FREE, max_slope_deg=15.0)
    points = stems("random", stand, on=rough)
    assert len(points) > 50
    assert rough.local_slope_deg(*points.T).max() <= 15.0
    assert rough.local_slope_deg(*stems("random", on=rough).T).max() > 20.0


@pytest.mark.parametrize("slope_deg", [0.0, 12.0, 30.0])
def test_the_ground_slopes_as_set_and_has_relief(slope_deg: float):
    ground = terrain(slope_deg=(slope_deg, slope_deg))
    x, y = np.random.default_rng(1).uniform(-30, 30, (2, 4000))
    columns = np.stack([x, y, np.ones_like(x)], -1)
    plane, *_ = np.linalg.lstsq(columns, ground.height_m(x, y), rcond=None)
    fitted_deg = np.degrees(np.arctan(np.hypot(*plane[:2])))
    residual = ground.height_m(x, y) - columns @ plane
    assert fitted_deg == pytest.approx(slope_deg, abs=2.5)
    assert 0.05 < residual.std() < 1.2


def test_grounds_of_no_weight_are_nowhere_and_one_dominates():
    only = terrain(grounds={"mud": 1.0})
    assert only.ground == "mud"
    assert only.cover.tolist() == [0.0, 0.0, 0.0, 1.0]
    mixed = [
        make_terrain(np.random.default_rng(seed), TerrainSettings(grounds={"moss": 3, "roots": 1}))
        for seed in range(40)
    ]
    share = np.mean([ground.ground == "moss" for ground in mixed])
    assert 0.55 < share < 0.95
    assert all((ground.cover > 0).sum() == 2 for ground in mixed)
    assert all(ground.cover.sum() == pytest.approx(1) for ground in mixed)
