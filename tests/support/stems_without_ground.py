"""Depth of stems on level ground, which is not seen."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float32

HEIGHT_M, FOCAL_PX, PITCH = 1.6, 500.0, 0.1
ROWS, COLUMNS = 480, 640


def ground_m() -> Float32:
    """(H, W) depth of level ground; 0 above the horizon."""
    falling = (np.arange(ROWS) + 0.5 - ROWS / 2) / FOCAL_PX + PITCH
    depth = np.where(falling > 0, HEIGHT_M / np.maximum(falling, 1e-6), 0.0)
    return np.repeat(depth[:, None], COLUMNS, axis=1).astype(np.float32)


def stems_m(*places: tuple[int, int, float]) -> Float32:
    """(H, W) depth of stems alone: first column, columns, distance."""
    depth_m, ground = np.zeros((ROWS, COLUMNS), np.float32), ground_m()
    for first, width, distance_m in places:
        above = (ground[:, 0] == 0) | (ground[:, 0] > distance_m)
        depth_m[above, first : first + width] = distance_m
    return depth_m


STEMS = stems_m((60, 40, 4.0), (250, 25, 6.0), (400, 18, 9.0), (560, 22, 7.0))
