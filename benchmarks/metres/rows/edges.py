"""Depth whose edges are not those of the picture: smoothed, averaged over frames, or shifted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from basetree.arrays import Float32
from benchmarks.metres.rows.clean import Readings, stand, stem
from benchmarks.metres.sensors import bilateral_filtered, mean_filtered, shifted, stereo_noise

Fault = Callable[[Float32, np.random.Generator], Float32]

_WALL_M = 14.0


def _smoothed(depth_m: Float32, rng: np.random.Generator) -> Float32:
    return mean_filtered(depth_m, int(rng.choice([3, 5, 7, 9, 11])))


def _edge_preserving(depth_m: Float32, rng: np.random.Generator) -> Float32:
    return bilateral_filtered(depth_m, int(rng.choice([5, 9])), rng.uniform(1.0, 6.0))


def _beside(depth_m: Float32, rng: np.random.Generator) -> Float32:
    return shifted(depth_m, float(rng.choice([-4, -3, -2, 2, 3, 4])))


def _ghost(depth_m: Float32, rng: np.random.Generator) -> Float32:
    old = shifted(depth_m, float(rng.choice([-5, -3, 3, 5])))
    share = rng.uniform(0.3, 0.7)
    seen = (depth_m > 0) & (old > 0)
    return np.where(seen, share * depth_m + (1 - share) * old, depth_m).astype(np.float32)


def _row(fault: Fault, given: bool) -> Callable[[np.random.Generator], Readings]:
    def draw(rng: np.random.Generator) -> Readings:
        """A stem before a forest edge, with the fault in its depth."""
        frame = stand(rng, [stem(rng)])
        far = (frame.depth_m == 0) | (frame.depth_m > _WALL_M)
        depth_m = np.where(far, np.float32(_WALL_M), frame.depth_m)
        frame.depth_m = fault(stereo_noise(depth_m, rng), rng)
        masks = frame.masks() if given else None
        return frame.readings(frame.detections(rng), given_masks=masks)

    return draw


_FAULTS = {
    "smoothed": _smoothed,
    "edge-preserving": _edge_preserving,
    "beside": _beside,
    "ghost": _ghost,
}

ROWS = {
    f"{name}-{'given' if given else 'network'}": _row(fault, given)
    for name, fault in _FAULTS.items()
    for given in (True, False)
}
