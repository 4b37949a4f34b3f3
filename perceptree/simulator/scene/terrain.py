"""The terrain: a height field on a grid that is finer near the centre, where the cameras are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from basetree.arrays import Float
from perceptree.simulator.materials.noise import spectral_noise
from perceptree.simulator.settings import GROUNDS, TerrainSettings

EXTENT_M = 42.0  # half the side of the terrain
_LINES = 300  # grid lines along each side
_FINE_SHARE = 0.30  # linear part of the spacing: smaller is finer at the centre


@dataclass(frozen=True)
class Terrain:
    """Height field of the ground.

    Attributes:
        lines_m: (n,) positions of the grid lines, the same in x and y, m.
        z_m: (n, n) ground heights; rows are y and columns are x, m.
        slope_deg: Mean slope.
        aspect_rad: Uphill direction of the mean slope, counter-clockwise from east.
        cover: (4,) fraction of each of GROUNDS.
    """

    lines_m: Float
    z_m: Float
    slope_deg: float
    aspect_rad: float
    cover: Float

    @property
    def ground(self) -> str:
        """The ground cover with the largest fraction."""
        return GROUNDS[int(np.argmax(self.cover))]

    def height_m(self, x_m: ArrayLike, y_m: ArrayLike) -> Float:
        """Exact height of the ground's triangles at (x, y), m; clamped at the border."""
        column, right = self._cell(np.asarray(x_m, np.float64))
        row, up = self._cell(np.asarray(y_m, np.float64))
        near, far = self.z_m[row, column], self.z_m[row + 1, column + 1]
        below_diagonal = near + (self.z_m[row, column + 1] - near) * right
        below_diagonal = below_diagonal + (far - self.z_m[row, column + 1]) * up
        above_diagonal = near + (self.z_m[row + 1, column] - near) * up
        above_diagonal = above_diagonal + (far - self.z_m[row + 1, column]) * right
        return np.asarray(np.where(right >= up, below_diagonal, above_diagonal))

    def local_slope_deg(self, x_m: ArrayLike, y_m: ArrayLike, step_m: float = 1.0) -> Float:
        """Slope of the ground at (x, y), degrees, over `step_m` to each side."""
        x, y = np.asarray(x_m, np.float64), np.asarray(y_m, np.float64)
        rise_x = self.height_m(x + step_m, y) - self.height_m(x - step_m, y)
        rise_y = self.height_m(x, y + step_m) - self.height_m(x, y - step_m)
        return np.degrees(np.arctan(np.hypot(rise_x, rise_y) / (2 * step_m)))

    def relative_altitude(self, x_m: ArrayLike, y_m: ArrayLike) -> Float:
        """Height relative to the mean slope, from -1 (lowest) to 1 (highest)."""
        level = self.height_m(x_m, y_m) - self._plane(np.asarray(x_m), np.asarray(y_m))
        flat = self.z_m - self._plane(self.lines_m[None], self.lines_m[:, None])
        return np.asarray(np.clip(level / max(float(np.abs(flat).max()), 1e-6), -1.0, 1.0))

    def _plane(self, x_m: Float, y_m: Float) -> Float:
        rise = np.tan(np.radians(self.slope_deg))
        along = np.cos(self.aspect_rad) * x_m + np.sin(self.aspect_rad) * y_m
        return np.asarray(rise * along)

    def _cell(self, value_m: Float) -> tuple[NDArray[np.intp], Float]:
        lines = self.lines_m
        index = np.clip(np.searchsorted(lines, value_m, side="right") - 1, 0, len(lines) - 2)
        share = (value_m - lines[index]) / (lines[index + 1] - lines[index])
        return index, np.clip(share, 0.0, 1.0)


def make_terrain(rng: np.random.Generator, settings: TerrainSettings) -> Terrain:
    """Draw a terrain: a tilted plane with relief in two scales and roughness.

    Args:
        rng: Source of random numbers.
        settings: Ranges of slope and relief, and weights of the ground covers.
    """
    share = np.linspace(-1.0, 1.0, _LINES)
    spread = _FINE_SHARE * np.abs(share) + (1 - _FINE_SHARE) * np.abs(share) ** 2.4
    lines_m = np.sign(share) * spread * EXTENT_M
    relief_m = rng.uniform(*settings.relief_m)
    relief = relief_m * spectral_noise(rng, (256, 256), 3.6)
    relief += 0.09 * relief_m * spectral_noise(rng, (256, 256), 2.1)
    cell = (lines_m + EXTENT_M) / (2 * EXTENT_M) * 255
    low = np.minimum(cell.astype(int), 254)
    weight = cell - low
    rows = relief[low] * (1 - weight)[:, None] + relief[low + 1] * weight[:, None]
    z_m = rows[:, low] * (1 - weight) + rows[:, low + 1] * weight
    z_m = z_m + rng.uniform(*settings.roughness_m) * spectral_noise(rng, (_LINES, _LINES), 1.6)
    slope_deg, aspect_rad = rng.uniform(*settings.slope_deg), rng.uniform(0, 2 * np.pi)
    cover = _draw_cover(rng, settings)
    terrain = Terrain(lines_m, z_m, slope_deg, aspect_rad, cover)
    plane = terrain._plane(lines_m[None], lines_m[:, None])
    return Terrain(lines_m, z_m + plane, slope_deg, aspect_rad, cover)


def _draw_cover(rng: np.random.Generator, settings: TerrainSettings) -> Float:
    """(4,) fractions of the ground covers: one dominates, the others are mixed in."""
    weights = np.array([settings.grounds.get(name, 0.0) for name in GROUNDS])
    first = rng.choice(len(GROUNDS), p=weights / weights.sum())
    cover = rng.uniform(0.0, 0.35, len(GROUNDS)) * (weights > 0)
    cover[first] = rng.uniform(0.6, 1.0)
    return np.asarray(cover / cover.sum())
