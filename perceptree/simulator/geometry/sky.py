"""Visibility of the sky through the canopy."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float, Float32, Int32, UInt8
from perceptree.simulator.materials.layers import CROWN_FOLIAGE
from perceptree.simulator.scene.terrain import EXTENT_M

_VOXEL_M = 1.0
_LEAF_EXTINCTION = 0.55  # extinction per unit of leaf area index
_LEAF_COVER = 0.45  # opaque fraction of a twig card


def _blur(layer: Float) -> Float:
    padded = np.pad(layer, 1, "edge")
    rows = (padded[:-2] + 2 * padded[1:-1] + padded[2:]) / 4
    return np.asarray((rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:]) / 4)


def sky_visibility(vertices: Float32, faces: Int32, layer: UInt8) -> Float32:
    """Compute the fraction of sky light that reaches each vertex through the canopy.

    Leaf area is counted in voxels of 1 m and summed from the top down, with a blur per layer that
    imitates slanting light. Light decreases exponentially with it (Beer-Lambert law; Monsi and
    Saeki 1953 for canopies).

    Args:
        vertices: (V, 3) m.
        faces: (F, 3) vertex numbers.
        layer: (F,) texture layers, which tell foliage from other faces.

    Returns:
        (V,) float32, 0 to 1.
    """
    leaf = faces[np.isin(layer, CROWN_FOLIAGE)]
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
    cell = np.clip((vertices - origin) / _VOXEL_M - 0.5, 0, highest - 1.001).astype(np.float32)
    low = cell.astype(np.int32)
    rest = cell - low
    visible = np.zeros(len(vertices), np.float32)
    for dz in (0, 1):
        for dy in (0, 1):
            for dx in (0, 1):
                share = np.abs(np.array([1 - dx, 1 - dy, 1 - dz], np.float32) - rest)
                weight = share[:, 0] * share[:, 1] * share[:, 2]
                visible += weight * open_sky[low[:, 2] + dz, low[:, 1] + dy, low[:, 0] + dx]
    return np.float32(0.16) + np.float32(0.84) * visible
