"""Simple solids that objects are composed of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Float
from perceptree.simulator.geometry.mesh import Mesh, make_mesh, merge, ring_frames, surface_mesh
from perceptree.simulator.materials.layers import PAINT_CELLS, Layer
from perceptree.simulator.vectors import unit

_BALL_RINGS, _BALL_SIDES = 7, 10
_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
_PAINT_SHARE = 0.5  # part of a colour's cell that is used, which avoids bleeding in mip levels
_CAP_M = 0.005  # length of a tube's closed ends


def block(
    centre: ArrayLike, size: Sequence[float], layer: Layer = Layer.PAINT, repeat_m: float = 1.0
) -> Mesh:
    """An axis-aligned box.

    Args:
        centre: (3,) centre, m.
        size: (3,) edge lengths, m.
        layer: Texture layer.
        repeat_m: Length of one texture repeat, m.
    """
    sides = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1.0, 1.0):
            corners = np.zeros((4, 3))
            corners[:, axis] = sign / 2
            corners[:, [first, second]] = _CORNERS
            normals = np.zeros((4, 3))
            normals[:, axis] = sign
            vertices = corners * np.asarray(size) + np.asarray(centre)
            uv = vertices[:, [1, 2] if axis == 0 else [0, 2] if axis == 1 else [0, 1]] / repeat_m
            faces = np.array([[0, 1, 2], [0, 2, 3]])
            sides.append(make_mesh(vertices, normals, uv, faces, layer))
    return merge(sides)


def ball(centre: ArrayLike, radii: Sequence[float], layer: Layer = Layer.PAINT) -> Mesh:
    """An axis-aligned ellipsoid.

    Args:
        centre: (3,) centre, m.
        radii: (3,) radii, m.
        layer: Texture layer.
    """
    polar = np.linspace(0.02, np.pi - 0.02, _BALL_RINGS)
    turn = np.linspace(0, 2 * np.pi, _BALL_SIDES + 1)
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], -1)
    rings = ring * np.sin(polar)[:, None, None]
    rings[..., 2] = -np.cos(polar)[:, None]
    middles = np.stack([0 * polar, 0 * polar, -np.cos(polar)], -1)
    centre_m, size_m = np.asarray(centre, float), np.asarray(radii, float)
    surface, axis = rings * size_m + centre_m, middles * size_m + centre_m
    mesh = surface_mesh(surface[None], axis[None], layer, 1.0, 1.0, 1.0)
    outwards = (np.asarray(mesh.vertices) - centre_m) / size_m**2
    normals = outwards / np.linalg.norm(outwards, axis=-1, keepdims=True)
    return replace(mesh, normals=normals)


def limb(
    points: ArrayLike,
    radii: Sequence[float] | Float,
    sides: int,
    layer: Layer = Layer.DEAD_WOOD,
    flat: float = 1.0,
) -> Mesh:
    """A tube with closed ends.

    Args:
        points: (n, 3) points of its axis, m.
        radii: (n,) radii, m.
        sides: Sides of the tube.
        layer: Texture layer.
        flat: Factor of the thickness along x.
    """
    path = np.asarray(points, float)
    path = np.concatenate([path[:1], path, path[-1:]])
    path[0] -= _CAP_M * unit(path[2] - path[1])
    path[-1] += _CAP_M * unit(path[-2] - path[-3])
    thick = np.array([1e-4, *radii, 1e-4])
    first, second = ring_frames(path[None])
    turn = np.linspace(0, 2 * np.pi, sides + 1)[:, None]
    across = np.cos(turn) * first[0][:, None] + np.sin(turn) * second[0][:, None]
    across = across * np.array([flat, 1.0, 1.0])
    vertices = path[:, None] + across * thick[:, None, None]
    return surface_mesh(vertices[None], path[None], layer, 1.0, 0.8, 1.0)


def painted(mesh: Mesh, colour: int) -> Mesh:
    """Give a mesh a plain colour.

    Args:
        mesh: The mesh.
        colour: Number of the colour in the layer PAINT.
    """
    cell = np.array([colour % PAINT_CELLS, colour // PAINT_CELLS])
    uv = (cell + 0.5 + _PAINT_SHARE * (np.asarray(mesh.uv) % 1.0 - 0.5)) / PAINT_CELLS
    return replace(mesh, uv=uv, layer=np.full_like(mesh.layer, Layer.PAINT))
