"""Mesh of the ground."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.geometry.mesh import Mesh, make_mesh, tube_faces
from perceptree.simulator.materials.layers import Layer
from perceptree.simulator.scene.terrain import Terrain
from perceptree.simulator.vectors import unit

_REPEAT_M = 1.7  # length of ground that one texture repeat shows


def ground_mesh(terrain: Terrain, snow_m: Float | None = None) -> Mesh:
    """Make the triangles of a height field, split along the diagonal that Terrain.height_m uses.

    Args:
        terrain: The soil.
        snow_m: (n, n) depths of the snow on the terrain's grid, m; the mesh is then the surface
            of the snow.
    """
    lines = terrain.lines_m
    z_m = terrain.z_m if snow_m is None else terrain.z_m + snow_m
    x, y = np.meshgrid(lines, lines)
    rise_y, rise_x = np.gradient(z_m, lines, lines)
    normals = unit(np.stack([-rise_x, -rise_y, np.ones_like(x)], -1))
    return make_mesh(
        np.stack([x, y, z_m], -1).reshape(-1, 3),
        normals.reshape(-1, 3),
        np.stack([x, y], -1).reshape(-1, 2) / _REPEAT_M,
        tube_faces(1, len(lines), len(lines) - 1),
        Layer.LITTER,
    )
