"""Clouds of terrestrial laser scanners that stand in a stand, at one place or at several."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float
from benchmarks.metres.scanner import Scanner, returns
from benchmarks.metres.stand import Stand
from calib import RigidTransform
from calib.clouds import PointCloud

LEVEL_AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Columns: the axes of a cloud (ahead, left, up) in those of a stand (right, down, ahead)."""
# Steps between beams, and how far a scan goes up and down.
_STEP_DEG, _HIGHEST_DEG, _LOWEST_DEG = 0.12, 35.0, -35.0


def tls(stand: Stand, places_m: Float, noise_m: float, rng: np.random.Generator) -> PointCloud:
    """Scan a stand from places around it, and put the scans together without errors.

    Args:
        stand: The stand.
        places_m: (P, 3) places of the scanners: right, down, ahead from its camera.
        noise_m: Standard deviation of a range.
        rng: Source of the noise.

    Returns:
        The points in a level frame with its origin at the camera: x ahead, y left, z up.
    """
    scanner = Scanner(2, step_deg=_STEP_DEG, noise_m=noise_m, bias_m=0, divergence_deg=0.02, lost=0)
    directions = _around(rng)
    parts = []
    for place_m in places_m:
        true = RigidTransform(stand.to_camera @ LEVEL_AXES, stand.to_camera @ place_m)
        divergence = np.radians(scanner.divergence_deg)
        ranges_m, beams = returns(stand, true, directions, place_m, divergence)
        ranges_m = ranges_m + rng.normal(0, noise_m, len(ranges_m))
        parts.append(directions[beams] * ranges_m[:, None] + LEVEL_AXES.T @ place_m)
    return PointCloud(np.concatenate(parts))


def _around(rng: np.random.Generator) -> Float:
    """(N, 3) unit vectors in all directions but steeply up and down."""
    elevation = np.radians(np.arange(_LOWEST_DEG, _HIGHEST_DEG, _STEP_DEG))
    azimuth = np.radians(np.arange(0, 360, _STEP_DEG) + rng.uniform(0, _STEP_DEG))
    up, left = (part.ravel() for part in np.meshgrid(elevation, azimuth, indexing="ij"))
    return np.stack([np.cos(up) * np.cos(left), np.cos(up) * np.sin(left), np.sin(up)], -1)
