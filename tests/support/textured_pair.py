"""Two pictures of a stem on level ground with a random texture, as a stereo pair sees them."""

from __future__ import annotations

import numpy as np
from phone_captures import cast, mounting

from calib import PinholeCamera, RigidTransform, pixels_to_rays
from calib.stereo import StereoPair

CAMERA = PinholeCamera(560, 420, 420.0, 420.0, 281.0, 207.0)
LENS = (-0.08, 0.02, 0.001, -0.0005)
BASELINE_M = 0.12
_CELLS_M = (0.2, 0.06, 0.02)
_SIZE = 32


def bent_pair(camera: PinholeCamera = CAMERA, *, turned: bool = True) -> StereoPair:
    """Cameras with lenses of their own, the right one turned by two degrees."""
    angles = (0.4, -1.0, 1.5) if turned else (0.0, 0.0, 0.0)
    place = RigidTransform.from_euler_deg(*angles, (BASELINE_M, 0.002, -0.003 * turned))
    if not turned:
        place = RigidTransform(np.eye(3), np.array([BASELINE_M, 0.0, 0.0]))
        return StereoPair(camera, camera, place.inverse())
    left = PinholeCamera(
        camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, LENS
    )
    right = PinholeCamera(
        camera.width, camera.height, 1.01 * camera.fx, 1.01 * camera.fy, camera.cx, camera.cy + 3
    )
    return StereoPair(left, right, place.inverse())


def _texture(points_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    total = np.full(points_m.shape[:-1], 120.0)
    for cell_m in _CELLS_M:
        volume = rng.uniform(-30, 30, (_SIZE, _SIZE, _SIZE))
        at = points_m / cell_m
        low = np.floor(at).astype(int)
        part = at - low
        for corner in range(8):
            step = np.array([corner & 1, corner >> 1 & 1, corner >> 2 & 1])
            cell = (low + step) % _SIZE
            weight = np.where(step, part, 1 - part).prod(-1)
            total += weight * volume[cell[..., 0], cell[..., 1], cell[..., 2]]
    return total


def pictures(pair: StereoPair, seed: int = 1000) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) uint8 BGR of both cameras."""
    found = []
    left = mounting(0)
    for number, camera in enumerate((pair.left, pair.right)):
        pose = left if number == 0 else pair.right_from_left.inverse().then(left)
        depth_m = cast(camera, pose)[0]
        rows, columns = np.mgrid[: camera.height, : camera.width]
        rays = pixels_to_rays(camera, np.stack([columns, rows], -1) + 0.5)
        points_m = pose.apply(rays * np.where(depth_m > 0, depth_m, 1)[..., None])
        grey = np.where(depth_m > 0, _texture(points_m, np.random.default_rng(seed)), 200.0)
        grey = grey + np.random.default_rng(seed + number + 1).normal(0, 2, grey.shape)
        grey = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
        found.append(np.repeat(grey[..., None], 3, axis=2))
    return found[0], found[1]
