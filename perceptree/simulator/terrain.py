"""The ground: a height field on a grid that is fine in the middle, where the camera stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from perceptree.simulator.mesh import Mesh, make_mesh, tube_faces, unit
from perceptree.simulator.noise import spectral_noise
from perceptree.simulator.settings import StandSettings
from perceptree.simulator.textures import Layer

Float = NDArray[np.floating[Any]]

EXTENT_M = 42.0
_LINES = 300
_FINE_SHARE = 0.30


@dataclass(frozen=True)
class Terrain:
    """Ground heights ``z_m`` (rows y, columns x) over the grid lines ``lines_m``, z up."""

    lines_m: Float
    z_m: Float

    def height_m(self, x_m: ArrayLike, y_m: ArrayLike) -> Float:
        """Height of the ground's triangles, exactly, at (x, y); clamped at the border."""
        column, right = self._cell(np.asarray(x_m, np.float64))
        row, up = self._cell(np.asarray(y_m, np.float64))
        near, far = self.z_m[row, column], self.z_m[row + 1, column + 1]
        below_diagonal = near + (self.z_m[row, column + 1] - near) * right
        below_diagonal = below_diagonal + (far - self.z_m[row, column + 1]) * up
        above_diagonal = near + (self.z_m[row + 1, column] - near) * up
        above_diagonal = above_diagonal + (far - self.z_m[row + 1, column]) * right
        return np.asarray(np.where(right >= up, below_diagonal, above_diagonal))

    def _cell(self, value_m: Float) -> tuple[NDArray[np.intp], Float]:
        lines = self.lines_m
        index = np.clip(np.searchsorted(lines, value_m, side="right") - 1, 0, len(lines) - 2)
        share = (value_m - lines[index]) / (lines[index + 1] - lines[index])
        return index, np.clip(share, 0.0, 1.0)

    def mesh(self) -> Mesh:
        """The ground as triangles, textured in 1.7 m repeats."""
        x, y = np.meshgrid(self.lines_m, self.lines_m)
        rise_y, rise_x = np.gradient(self.z_m, self.lines_m, self.lines_m)
        normals = unit(np.stack([-rise_x, -rise_y, np.ones_like(x)], -1))
        uv = np.stack([x, y], -1).reshape(-1, 2) / 1.7
        count = len(self.lines_m)
        return make_mesh(
            np.stack([x, y, self.z_m], -1).reshape(-1, 3),
            normals.reshape(-1, 3),
            uv,
            tube_faces(1, count, count - 1),
            Layer.LITTER,
        )


def make_terrain(rng: np.random.Generator, settings: StandSettings) -> Terrain:
    """A tilted plane with rolling relief and centimetres of roughness."""
    share = np.linspace(-1.0, 1.0, _LINES)
    spread = _FINE_SHARE * np.abs(share) + (1 - _FINE_SHARE) * np.abs(share) ** 2.4
    lines_m = np.sign(share) * spread * EXTENT_M
    relief = rng.uniform(*settings.relief_m) * spectral_noise(rng, (256, 256), 3.6)
    relief += 0.03 * spectral_noise(rng, (256, 256), 2.1)
    cell = (lines_m + EXTENT_M) / (2 * EXTENT_M) * 255
    low = np.minimum(cell.astype(int), 254)
    weight = cell - low
    rows = relief[low] * (1 - weight)[:, None] + relief[low + 1] * weight[:, None]
    z_m = rows[:, low] * (1 - weight) + rows[:, low + 1] * weight
    z_m = z_m + 0.012 * spectral_noise(rng, (_LINES, _LINES), 1.6)
    slope = np.tan(np.radians(rng.uniform(*settings.slope_deg)))
    direction = rng.uniform(0, 2 * np.pi)
    tilt = np.cos(direction) * lines_m[None] + np.sin(direction) * lines_m[:, None]
    return Terrain(lines_m, z_m + slope * tilt)
