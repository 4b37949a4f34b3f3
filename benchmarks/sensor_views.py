"""Pictures of many depth cameras, drawn on the exact depth of simulated frames.

They are written apart from the cameras that trainings draw (`perceptree.data.augment.cameras`), so
that a network is not judged by what it was trained on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from basetree.arrays import Bool, Float32
from benchmarks.metres.sensors import bilateral_filtered, mean_filtered, shifted, without
from calib import PinholeCamera, depth_to_points, fit_ground_plane
from perceptree.simulator.sensors.depth import measure_depth
from perceptree.simulator.settings import DepthSettings

STEREO = DepthSettings(kinds={"stereo": 1.0}, half_resolution=False)
TOF = DepthSettings(kinds={"tof": 1.0}, half_resolution=False)
BOARD = DepthSettings(kinds={"stereo": 1.0})
_GROUND_M = 0.1
_SAMPLED = 5  # every fifth point gives the ground
_RINGS_PX, _BEAMS_PX = 4, 2
_HELD_PX = 8.0

Sensor = Callable[[np.random.Generator, Float32, PinholeCamera], Float32]
"""Readings (H, W) in m, 0 for none, of exact depth (H, W) as a camera sees it."""


@dataclass(frozen=True)
class SensorView:
    """A depth camera.

    Attributes:
        name: What it is.
        width: Width of its picture, px.
        height: Height of its picture, px.
        sensor: What it reads.
        upper: It sees the upper half of the frame alone.
    """

    name: str
    width: int
    height: int
    sensor: Sensor
    upper: bool = False

    def window(self, width: int, height: int) -> tuple[int, int, int, int]:
        """The middle part of a frame that it sees: x0, y0, x1, y1 in px of the frame."""
        down = height // 2 if self.upper else height
        across = min(width, round(down * self.width / self.height))
        down = min(down, round(across * self.height / self.width))
        left = (width - across) // 2
        return left, 0, left + across, down

    def depth_of(self, depth_m: Float32) -> Float32:
        """(height, width) of the exact depth of a frame, by the nearest pixel."""
        x0, y0, x1, y1 = self.window(depth_m.shape[1], depth_m.shape[0])
        part, size = np.ascontiguousarray(depth_m[y0:y1, x0:x1]), (self.width, self.height)
        return np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_NEAREST_EXACT), np.float32)

    def mask_of(self, mask: Bool) -> Bool:
        """(height, width) pixels of which at least half belong to a mask of the frame."""
        x0, y0, x1, y1 = self.window(mask.shape[1], mask.shape[0])
        part = mask[y0:y1, x0:x1].astype(np.float32)
        way = cv2.INTER_AREA if x1 - x0 > self.width else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(part, (self.width, self.height), interpolation=way) >= 0.5)

    def camera_of(self, camera: PinholeCamera) -> PinholeCamera:
        """Intrinsics of its picture."""
        x0, y0, x1, _ = self.window(camera.width, camera.height)
        scale = self.width / (x1 - x0)
        focal = camera.fx * scale
        centre = ((camera.cx + 0.5 - x0) * scale - 0.5, (camera.cy + 0.5 - y0) * scale - 0.5)
        return PinholeCamera(self.width, self.height, focal, focal, *centre)


def simulated(settings: DepthSettings) -> Sensor:
    """A camera of the simulator."""
    return lambda rng, depth_m, camera: measure_depth(rng, settings, depth_m, camera).depth_m


def exact(rng: np.random.Generator, depth_m: Float32, camera: PinholeCamera) -> Float32:
    """The depth as it is."""
    return depth_m


def averaged(rng: np.random.Generator, depth_m: Float32, camera: PinholeCamera) -> Float32:
    """Stereo, then the mean of 5x5 px."""
    return mean_filtered(simulated(STEREO)(rng, depth_m, camera), 5)


def edge_preserving(rng: np.random.Generator, depth_m: Float32, camera: PinholeCamera) -> Float32:
    """Stereo, then an edge-preserving filter, and holes filled from the right."""
    found = bilateral_filtered(simulated(STEREO)(rng, depth_m, camera), 5, 0.3)
    for column in range(found.shape[1] - 2, -1, -1):
        hole = found[:, column] == 0
        found[hole, column] = found[hole, column + 1]
    return found


def dense(rng: np.random.Generator, depth_m: Float32, camera: PinholeCamera) -> Float32:
    """Depth whose edges are ramps and whose holes are closed, as learned matching gives."""
    inverse = np.where(depth_m > 0, 1 / np.maximum(depth_m, 0.1), 0).astype(np.float32)
    smooth = cv2.GaussianBlur(cv2.medianBlur(inverse, 5), (0, 0), 1.5)
    return np.where(smooth > 1 / 20, 1 / np.maximum(smooth, 1e-3), 0).astype(np.float32)


def rings(rng: np.random.Generator, depth_m: Float32, camera: PinholeCamera) -> Float32:
    """Every fourth row and every second column of it, noise of 2 cm, each reading 2x2 px."""
    rows, columns = np.indices(depth_m.shape)
    hit = (rows % _RINGS_PX == 0) & (columns % _BEAMS_PX == 0) & (depth_m > 0)
    found = np.where(hit, depth_m + 0.02 * rng.standard_normal(depth_m.shape), 0)
    return np.asarray(cv2.dilate(found.astype(np.float32), np.ones((2, 2), np.uint8)), np.float32)


def no_ground(rng: np.random.Generator, depth_m: Float32, camera: PinholeCamera) -> Float32:
    """Exact depth without what lies within 10 cm of the ground's plane or below it."""
    points = depth_to_points(camera, depth_m)
    plane = fit_ground_plane(points[depth_m > 0][::_SAMPLED])
    if not plane:
        return depth_m
    height_m = plane.height_m(points.reshape(-1, 3)).reshape(depth_m.shape)
    return without(depth_m, height_m < _GROUND_M)


def held(rng: np.random.Generator, depth_m: Float32, camera: PinholeCamera) -> Float32:
    """Stereo whose holes show an earlier picture."""
    found = simulated(STEREO)(rng, depth_m, camera)
    earlier = shifted(found, float(rng.uniform(-_HELD_PX, _HELD_PX)))
    return np.where(found > 0, found, earlier).astype(np.float32)


VIEWS = (
    SensorView("stereo, on board", 1280, 720, simulated(BOARD)),
    SensorView("stereo", 1280, 720, simulated(STEREO)),
    SensorView("stereo", 848, 480, simulated(STEREO)),
    SensorView("stereo", 640, 480, simulated(STEREO)),
    SensorView("stereo, mean of 5 px", 848, 480, averaged),
    SensorView("stereo, edge-preserving, filled", 848, 480, edge_preserving),
    SensorView("stereo, held in time", 848, 480, held),
    SensorView("dense, ramps at edges", 640, 480, dense),
    SensorView("time of flight", 640, 480, simulated(TOF)),
    SensorView("time of flight", 256, 192, simulated(TOF)),
    SensorView("time of flight, portrait", 192, 256, simulated(TOF)),
    SensorView("exact", 1280, 720, exact),
    SensorView("exact", 640, 480, exact),
    SensorView("exact", 256, 192, exact),
    SensorView("exact, portrait", 480, 640, exact),
    SensorView("exact, upper half", 640, 480, exact, upper=True),
    SensorView("exact, no readings of the ground", 640, 480, no_ground),
    SensorView("lidar, every fourth row", 640, 480, rings),
)
