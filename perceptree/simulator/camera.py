"""Where the camera stands and looks, and which parts of a scene it can see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera
from perceptree.simulator.scene import VIEW_RADIUS_M, Scene
from perceptree.simulator.settings import CameraSettings

Float = NDArray[np.floating[Any]]

_STEM_CLEARANCE_M = 0.8
_TRIES = 60


@dataclass(frozen=True)
class View:
    """A posed camera: ``origin`` (3,) world metres, ``rotation`` (3, 3) rows right, down, forward.

    ``intrinsics`` follow OpenCV: pixel centres on whole numbers.
    """

    intrinsics: PinholeCamera
    origin: Float
    rotation: Float

    @property
    def up(self) -> Float:
        """(3,) unit vector upwards in the camera frame, as an IMU gives it."""
        return np.asarray(self.rotation[:, 2])

    def to_camera(self, points_m: Float) -> Float:
        """World points (..., 3) in the camera frame: x right, y down, z forward."""
        return np.asarray((points_m - self.origin) @ self.rotation.T)

    def project(self, points_m: Float) -> Float:
        """World points (..., 3) in front of the camera to (..., 2) px, corner-based."""
        local = self.to_camera(points_m)
        camera = self.intrinsics
        scale = local[..., :2] / local[..., 2:]
        return np.asarray(scale * (camera.fx, camera.fy) + (camera.cx + 0.5, camera.cy + 0.5))


def look_from(
    settings: CameraSettings, origin: Float, yaw_rad: float, pitch_rad: float, roll_rad: float
) -> View:
    """A view from ``origin``: yaw turns left from east, pitch up, roll clockwise."""
    flat = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    forward = np.cos(pitch_rad) * flat + np.sin(pitch_rad) * up
    right = np.cross(flat, up)
    down = np.cross(forward, right)
    cos, sin = np.cos(roll_rad), np.sin(roll_rad)
    rotation = np.stack([cos * right + sin * down, cos * down - sin * right, forward])
    focal = settings.focal_px
    intrinsics = PinholeCamera(
        settings.width, settings.height, focal, focal, (settings.width - 1) / 2,
        (settings.height - 1) / 2,
    )  # fmt: skip
    return View(intrinsics, np.asarray(origin), rotation)


def random_view(rng: np.random.Generator, settings: CameraSettings, scene: Scene) -> View:
    """Stand somewhere in the middle of the scene, clear of stems, and look anywhere."""
    feet = np.array([tree.position_m[:2] for tree in scene.trees]).reshape(-1, 2)
    place = np.zeros(2)
    for _ in range(_TRIES):
        distance, angle = VIEW_RADIUS_M * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
        place = distance * np.array([np.cos(angle), np.sin(angle)])
        if not len(feet) or np.hypot(*(feet - place).T).min() > _STEM_CLEARANCE_M:
            break
    height = float(scene.terrain.height_m(*place)) + rng.uniform(*settings.height_m)
    pitch, roll = (np.radians(rng.uniform(*r)) for r in (settings.pitch_deg, settings.roll_deg))
    return look_from(
        settings, np.array([*place, height]), rng.uniform(0, 2 * np.pi), float(pitch), float(roll)
    )


def visible_faces(scene: Scene, view: View) -> NDArray[np.int64]:
    """Numbers of the faces of all instances whose bounding sphere meets the view, nearest first."""
    camera = view.intrinsics
    local = view.to_camera(scene.instance_centre)
    radius = scene.instance_radius
    inside = local[:, 2] > -radius
    for axis, size, focal in ((0, camera.width, camera.fx), (1, camera.height, camera.fy)):
        edge = 0.5 * size / focal
        inside &= np.abs(local[:, axis]) - edge * local[:, 2] < radius * np.hypot(1.0, edge)
    chosen = np.nonzero(inside)[0]
    chosen = chosen[np.argsort(np.linalg.norm(local[chosen], axis=1) - radius[chosen])]
    start = scene.instance_start[chosen]
    count = scene.instance_start[chosen + 1] - start
    shift = np.repeat(start - np.concatenate([[0], np.cumsum(count)[:-1]]), count)
    return np.asarray(np.arange(count.sum()) + shift)
