"""Scans of a rotating laser scanner beside the camera of a stand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from basetree.arrays import Float
from benchmarks.metres.caster import FARTHEST_M
from benchmarks.metres.stand import Stand
from calib import RigidTransform
from calib.clouds import PointCloud

# The beam's footprint: its middle, and four places at the half of its divergence.
_SPREAD = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
# Surfaces within one pulse's length give one return between them.
_PULSE_M = 0.4


@dataclass(frozen=True)
class Scanner:
    """A rotating scanner; angles as of data sheets of scanners with so many rings.

    Attributes:
        rings: Number of beams one above the other.
        highest_deg, lowest_deg: Elevations of the first and the last ring.
        step_deg: Azimuth from one firing to the next.
        noise_m: Standard deviation of a range.
        bias_m: The same of the error that all ranges of a scan share.
        divergence_deg: Full angle of a beam.
        lost: Share of the beams without a return.
    """

    rings: int
    highest_deg: float = 15.0
    lowest_deg: float = -15.0
    step_deg: float = 0.2
    noise_m: float = 0.02
    bias_m: float = 0.01
    divergence_deg: float = 0.17
    lost: float = 0.05


SCANNERS = {
    16: Scanner(16),
    32: Scanner(32, 16.0, -16.0),
    64: Scanner(64, 16.6, -16.6, 0.35),
    128: Scanner(128, 22.5, -22.5, 0.35),
}


@dataclass(frozen=True, eq=False)
class Scan:
    """A scan, and where the scanner is believed to be.

    Attributes:
        cloud: Points in the scanner's frame: x ahead, y left, z up when it is level.
        to_camera: Transform to the camera's frame, as a calibration gives it.
    """

    cloud: PointCloud
    to_camera: RigidTransform


def scan(
    stand: Stand,
    scanner: Scanner,
    rng: np.random.Generator,
    rotation_std_deg: float = 0.1,
    translation_std_m: float = 0.01,
) -> Scan:
    """Scan a stand from beside its camera.

    Args:
        stand: The stand.
        scanner: The scanner.
        rng: Source of its place, tilt, noise and calibration.
        rotation_std_deg, translation_std_m: Errors of the calibration about and along each axis.
    """
    place = np.array([rng.uniform(-0.6, 0.6), -rng.uniform(0.1, 0.8), rng.uniform(-0.5, 0.3)])
    roll, pitch, yaw = rng.normal(0, (2, 2, 5))
    camera_m = (stand.to_camera @ place).tolist()
    # The columns of the level scanner's axes (ahead, left, up) in level axes (right, down, ahead).
    axes = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    tilt = RigidTransform.from_euler_deg(roll, pitch, yaw, np.zeros(3)).rotation
    true = RigidTransform(stand.to_camera @ axes @ tilt, camera_m)
    directions = _directions(scanner, rng)
    ranges_m, beams = _returns(stand, true, directions, place, np.radians(scanner.divergence_deg))
    ranges_m = (
        ranges_m + rng.normal(0, scanner.bias_m) + rng.normal(0, scanner.noise_m, len(ranges_m))
    )
    kept = rng.random(len(ranges_m)) >= scanner.lost
    points = directions[beams[kept]] * ranges_m[kept, None]
    about_x, about_y, about_z = rng.normal(0, rotation_std_deg, 3).tolist()
    aside_m = rng.normal(0, translation_std_m, 3)
    wrong = RigidTransform.from_euler_deg(about_x, about_y, about_z, aside_m)
    return Scan(PointCloud(points), wrong.then(true))


def _directions(scanner: Scanner, rng: np.random.Generator) -> Float:
    """(N, 3) unit vectors of the beams ahead, in the scanner's frame."""
    elevation = np.radians(np.linspace(scanner.highest_deg, scanner.lowest_deg, scanner.rings))
    azimuth = np.radians(np.arange(-70, 70, scanner.step_deg) + rng.uniform(0, scanner.step_deg))
    up, left = (part.ravel() for part in np.meshgrid(elevation, azimuth, indexing="ij"))
    return np.stack([np.cos(up) * np.cos(left), np.cos(up) * np.sin(left), np.sin(up)], -1)


def _returns(
    stand: Stand, true: RigidTransform, directions: Float, place: Float, divergence_rad: float
) -> tuple[Float, Float]:
    """Ranges (M,) of the returns and the numbers (M,) of their beams.

    A beam that hits two surfaces gives two returns, or one between them if they are near.
    """
    side = np.cross(directions, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    over = np.cross(side, directions)
    hits = []
    for across, up in _SPREAD * divergence_rad / 2:
        rays = directions + across * side + up * over
        hits.append(_ranges(stand, true.rotate(rays), place))
    hits_m = np.sort(np.stack(hits, -1), axis=1)
    near = hits_m < hits_m[:, :1] + _PULSE_M
    returned = np.isfinite(hits_m)
    found, beams = [], []
    for part in (near & returned, ~near & returned):
        rows = np.flatnonzero(part.any(1))
        total = np.where(part[rows], hits_m[rows], 0.0).sum(1)
        found.append(total / part[rows].sum(1))
        beams.append(rows)
    return np.concatenate(found), np.concatenate(beams)


def _ranges(stand: Stand, rays: Float, place: Float) -> Float:
    """(N,) distances along rays (N, 3) of the camera's frame from the scanner; infinite if none."""
    level = rays @ stand.to_camera
    ground, flat = stand.ground, [0, 2]
    falling = level[:, 1] + level[:, flat] @ ground.gradient
    hit = falling > 1e-6
    safe = np.where(hit, falling, 1.0)
    above_m = ground.camera_height_m - place[1] - place[flat] @ ground.gradient
    found = np.where(hit, above_m / safe, np.inf)
    for _ in range(3):
        at = place[flat] + np.where(hit, found, 0.0)[:, None] * level[:, flat]
        found = np.where(hit, (above_m - ground.bump_at_m(at)) / safe, np.inf)
    start_m = stand.to_camera @ place
    for cone in stand.cones:
        moved = replace(cone, start_m=cone.start_m - start_m)
        found = np.minimum(found, moved.cast(rays))
    return np.where(found < FARTHEST_M, found, np.inf)
