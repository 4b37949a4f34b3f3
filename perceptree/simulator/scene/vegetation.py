"""Cover that hides the ground: dense grass, hedges, and snow with a depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from basetree.arrays import Bool, Float
from perceptree.simulator.materials.noise import spectral_noise
from perceptree.simulator.scene.conditions import Weather
from perceptree.simulator.scene.scatter import Placement, place
from perceptree.simulator.scene.terrain import Terrain
from perceptree.simulator.settings import VegetationSettings
from perceptree.simulator.streams import Stream, stream

TUFT_ASPECTS = {"low": 0.35, "middle": 0.7, "high": 1.1}  # height over width, by shape
_NO_GRASS_SNOW_M = 0.03  # grass lies flat under deeper snow
_GRASS, _HEDGES, _SNOW = range(3)  # numbers of the random streams

_TUFT_WIDTH_M = 0.38  # width of tufts near the cameras
_TUFTS = 3.6  # number of tufts per area, times their width and height
_FULL_M, _REACH_M = 10.0, 30.0  # distances from the centre: of full density, and of the last tuft
_THINNING = 3.0  # the density decreases with this power of the distance
_PATCH_CELL_M = 0.25  # cell of the noise that decides where grass stands
_PATCH_CELLS = 48  # its period, which keeps the share nearly the same everywhere
_PATCH_EXPONENT = 2.4  # spectrum of that noise
_HEIGHT_SPREAD = 0.25  # tufts differ from the mean height by up to this fraction
_BARK_GAP_M = 0.02

_HEDGE_DISTANCE_M = (7.5, 13.0)  # from the centre, so that no camera stands in a hedge
_HEDGE_LENGTH_M = (8.0, 30.0)
_HEDGE_BEND_PER_M = (-0.005, 0.02)
_SHRUB_HEIGHT_M = 1.2  # height of a shrub's mesh
_SHRUB_STEP = 0.3  # distance of shrubs along a hedge over its height
_HEDGE_GAPS = 0.06  # fraction of missing shrubs
_BEECH_SHARE = 0.4  # fraction of hedges of beech
_PATH_CLEARANCE_M = 1.6

_SNOW_SPREAD = 0.15  # standard deviation of the depth over its mean
_WELL_M, _WELL_SHARE = 0.4, 0.5  # hollows in the snow at stems: radius, and part of the depth


@dataclass(frozen=True)
class Vegetation:
    """What hides the ground of a scene.

    Attributes:
        grass_cover: Fraction of the ground that dense grass stands on.
        grass_height_m: Mean height of that grass, m; 0 without grass.
        hedges: Number of hedges.
        snow_depth_m: Mean depth of the snow, m; 0 if snow is only a colour.
        snow_m: (n, n) depths of the snow on the terrain's grid, m; None without depth.
        placements: Grass and hedges.
    """

    grass_cover: float
    grass_height_m: float
    hedges: int
    snow_depth_m: float
    snow_m: Float | None
    placements: list[Placement]


def grow_vegetation(
    seed: int,
    settings: VegetationSettings,
    terrain: Terrain,
    weather: Weather,
    stems_m: Float,
    path_m: Float,
) -> Vegetation:
    """Draw the cover of a scene's ground. Grass, hedges and snow have streams of their own.

    Args:
        seed: Seed of the scene.
        settings: How often, how dense and how high.
        terrain: The ground.
        weather: The weather; only lying snow has a depth.
        stems_m: (n, 3) x, y and radius of the stems, m.
        path_m: (m, 2) points of a drive's path, which hedges keep clear of, m.
    """
    rng = stream(seed, Stream.VEGETATION, _SNOW)
    depth_m = float(rng.uniform(*settings.snow_depth_m)) if weather.snow > 0 else 0.0
    snow_m = _snow(rng, depth_m, terrain, stems_m) if depth_m > 0 else None
    rng = stream(seed, Stream.VEGETATION, _GRASS)
    grassy = rng.random() < settings.grass_share and depth_m < _NO_GRASS_SNOW_M
    cover, height_m = rng.uniform(*settings.grass_cover), rng.uniform(*settings.grass_height_m)
    placements = _grass(rng, float(cover), float(height_m), terrain, stems_m) if grassy else []
    rng = stream(seed, Stream.VEGETATION, _HEDGES)
    hedges = 0
    if rng.random() < settings.hedge_share:
        hedges = round(rng.uniform(*settings.hedges))
        for _ in range(hedges):
            placements.append(_hedge(rng, settings.hedge_height_m, terrain, path_m))
    return Vegetation(
        float(cover) if grassy else 0.0,
        float(height_m) if grassy else 0.0,
        hedges,
        depth_m,
        snow_m,
        placements,
    )


def _grass(
    rng: np.random.Generator, cover: float, height_m: float, terrain: Terrain, stems_m: Float
) -> list[Placement]:
    """Tufts in irregular patches: dense near the cameras, sparser and wider far off."""
    aspects = np.array(list(TUFT_ASPECTS.values()))
    near = int(np.argmin(np.abs(np.log(aspects * _TUFT_WIDTH_M / height_m))))
    step_m = height_m / float(np.sqrt(aspects[near] * _TUFTS))
    line_m = np.arange(-_REACH_M, _REACH_M, step_m)
    x, y = (axis.ravel() for axis in np.meshgrid(line_m, line_m))
    x, y = x + step_m * rng.random(len(x)), y + step_m * rng.random(len(x))
    density = (_FULL_M / np.maximum(np.hypot(x, y), _FULL_M)) ** _THINNING
    kept = (rng.random(len(x)) < density) & (np.hypot(x, y) < _REACH_M)
    kept &= _in_patches(rng, cover, x, y) & _outside_stems(x, y, stems_m)
    x, y, density = x[kept], y[kept], density[kept]
    shape = np.where(rng.random(len(x)) < density, near, 0)
    dry = rng.random(len(x)) < rng.random() ** 2
    scale = height_m * rng.uniform(1 - _HEIGHT_SPREAD, 1 + _HEIGHT_SPREAD, len(x))
    placements = []
    for tone, toned in (("green", ~dry), ("dry", dry)):
        for number, name in enumerate(TUFT_ASPECTS):
            chosen = toned & (shape == number)
            if chosen.any():
                kind = f"{tone}_{name}_tuft"
                places_m = np.stack([x[chosen], y[chosen]], -1)
                placements.append(
                    place(rng, kind, terrain, places_m, scale[chosen], follows_slope=True)
                )
    return placements


def _in_patches(rng: np.random.Generator, cover: float, x: Float, y: Float) -> Bool:
    """(n,) whether points are where grass stands: the share `cover` of the ground's area."""
    noise = spectral_noise(rng, (_PATCH_CELLS, _PATCH_CELLS), _PATCH_EXPONENT)
    column, row = (np.floor(axis / _PATCH_CELL_M).astype(int) % _PATCH_CELLS for axis in (x, y))
    return np.asarray(noise[row, column] < np.quantile(noise, cover))


def _outside_stems(x: Float, y: Float, stems_m: Float) -> Bool:
    inside = np.zeros(len(x), np.bool_)
    for stem_x, stem_y, radius_m in stems_m:
        inside |= np.hypot(x - stem_x, y - stem_y) < radius_m + _BARK_GAP_M
    return ~inside


def _hedge(
    rng: np.random.Generator, heights_m: tuple[float, float], terrain: Terrain, path_m: Float
) -> Placement:
    """A bent row of shrubs of one kind that passes the cameras' area."""
    kind = ("hedge_shrub", "beech_hedge_shrub")[int(rng.random() < _BEECH_SHARE)]
    height_m, length_m = rng.uniform(*heights_m), rng.uniform(*_HEDGE_LENGTH_M)
    distance_m, bend = rng.uniform(*_HEDGE_DISTANCE_M), rng.uniform(*_HEDGE_BEND_PER_M)
    angle, middle_m = rng.uniform(0, 2 * np.pi), rng.uniform(-0.3, 0.3) * length_m
    step_m = _SHRUB_STEP * height_m
    along = np.arange(-length_m / 2, length_m / 2, step_m) + middle_m
    away = distance_m + bend * along**2
    away, along = (axis + 0.25 * step_m * rng.normal(0, 1, len(axis)) for axis in (away, along))
    x = away * np.cos(angle) - along * np.sin(angle)
    y = away * np.sin(angle) + along * np.cos(angle)
    kept = rng.random(len(x)) > _HEDGE_GAPS
    kept &= np.hypot(x, y) < _REACH_M
    for point in path_m:
        kept &= np.hypot(x - point[0], y - point[1]) > _PATH_CLEARANCE_M
    places_m = np.stack([x, y], -1)[kept]
    scale = height_m / _SHRUB_HEIGHT_M * rng.uniform(0.85, 1.15, len(places_m))
    return place(rng, kind, terrain, places_m, scale)


def _snow(rng: np.random.Generator, depth_m: float, terrain: Terrain, stems_m: Float) -> Float:
    """(n, n) depths of the snow on the terrain's grid, with hollows at stems, m."""
    lines_m = terrain.lines_m
    x, y = np.meshgrid(lines_m, lines_m)
    relief = spectral_noise(rng, (len(lines_m), len(lines_m)), 3.0)
    depths_m = depth_m * np.clip(1 + _SNOW_SPREAD * relief, 0.5, 1.5)
    for stem_x, stem_y, radius_m in stems_m:
        gap_m = np.maximum(np.hypot(x - stem_x, y - stem_y) - radius_m, 0)
        depths_m *= 1 - _WELL_SHARE * np.exp(-((gap_m / _WELL_M) ** 2))
    return np.asarray(depths_m)
