"""Camera views of a scene, and the faces that are visible from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import calib
from basetree.arrays import Float, Int64
from calib import PinholeCamera
from perceptree.simulator.geometry.assemble import SceneMesh
from perceptree.simulator.scene.description import Scene
from perceptree.simulator.settings import CameraSettings, PoseSettings
from perceptree.simulator.vectors import heading

VIEW_RADIUS_M = 6.0  # cameras are within this distance of the scene's centre
_STEM_CLEARANCE_M = 0.8
_ATTEMPTS = 60
_BORDER_POINTS = 33
_RADII = 1024  # at which a distortion is tested for turning back


@dataclass(frozen=True)
class Pose:
    """How the camera is carried.

    Attributes:
        carrier: `mast`, `hand` or `drive`.
        height_m: Height above the ground, m.
        pitch_deg: Pitch, positive upwards.
        roll_deg: Roll, positive clockwise.
        yaw_deg: Yaw, counter-clockwise from east.
    """

    carrier: str
    height_m: float
    pitch_deg: float
    roll_deg: float
    yaw_deg: float


@dataclass(frozen=True)
class View:
    """A camera with its position and orientation.

    Attributes:
        intrinsics: The camera, in OpenCV's convention: pixel centres have integer coordinates.
        origin: (3,) position in the world, m.
        rotation: (3, 3) axes in the world; the rows are right, down and forward.
        pose: How the camera is carried.
    """

    intrinsics: PinholeCamera
    origin: Float
    rotation: Float
    pose: Pose

    @property
    def up(self) -> Float:
        """(3,) unit vector upwards in camera axes, as an IMU gives it."""
        return np.asarray(self.rotation[:, 2])

    @cached_property
    def _border_rays(self) -> Float:
        """(n, 2) x / z and y / z of the rays through the image's border."""
        camera = self.intrinsics
        x = np.linspace(0.0, camera.width, _BORDER_POINTS)
        y = np.linspace(0.0, camera.height, _BORDER_POINTS)
        border = [
            np.stack(np.broadcast_arrays(*edge), -1)
            for edge in ((x, 0.0), (x, float(camera.height)), (0.0, y), (float(camera.width), y))
        ]
        return np.asarray(calib.pixels_to_rays(camera, np.concatenate(border))[:, :2])

    @cached_property
    def ray_bounds(self) -> tuple[float, float, float, float]:
        """Minimum and maximum of x / z, then of y / z, of the rays through the image's border."""
        low, high = self._border_rays.min(0), self._border_rays.max(0)
        return float(low[0]), float(high[0]), float(low[1]), float(high[1])

    @cached_property
    def _farthest(self) -> float:
        """Largest distance of a ray from the axis, over z, up to which the image's lens holds."""
        radius = np.linspace(0, float(np.hypot(*self._border_rays.T).max()), _RADII)
        along = np.stack([radius, np.zeros(_RADII), np.ones(_RADII)], -1)
        falling = np.flatnonzero(np.diff(calib.project_points(self.intrinsics, along)[:, 0]) <= 0)
        return float(radius[falling[0] if len(falling) else -1])

    def to_camera(self, points_m: Float) -> Float:
        """Transform world points (..., 3) to camera axes: x right, y down, z forward, m."""
        return np.asarray((points_m - self.origin) @ self.rotation.T)

    def project(self, points_m: Float) -> Float:
        """Project world points (..., 3) in front of the camera to corner-based px (..., 2).

        A distortion holds within the image. Far outside, many models fold points back into it. A
        point farther off the axis than any point of the image is projected along its direction
        with the scale at that limit, so that it stays outside.
        """
        camera, points = self.intrinsics, self.to_camera(points_m)
        pixels = calib.project_points(camera, points)
        if camera.distortion:
            ahead = points[..., 2] > 0
            off_axis = np.hypot(points[..., 0], points[..., 1]) / np.where(ahead, points[..., 2], 1)
            beyond = off_axis / self._farthest
            far = ahead & (beyond > 1)
            share = beyond[far][:, None]
            pulled_in = np.concatenate([points[far, :2] / share, points[far, 2:]], -1)
            at_limit = calib.project_points(camera, pulled_in)
            middle = np.array([camera.cx, camera.cy]) + 0.5
            pixels[far] = middle + (at_limit - middle) * share
        return pixels


def look_from(intrinsics: PinholeCamera, origin: Float, pose: Pose) -> View:
    """Make the view of a camera at `origin` (3,) with the angles of `pose`."""
    yaw, pitch, roll = np.radians([pose.yaw_deg, pose.pitch_deg, pose.roll_deg])
    flat = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    forward = np.cos(pitch) * flat + np.sin(pitch) * up
    right = np.cross(flat, up)
    down = np.cross(forward, right)
    cos, sin = np.cos(roll), np.sin(roll)
    rotation = np.stack([cos * right + sin * down, cos * down - sin * right, forward])
    return View(intrinsics, np.asarray(origin), rotation, pose)


def _random_pose(rng: np.random.Generator, settings: CameraSettings) -> Pose:
    on_mast = rng.random() < settings.mast_share
    ranges: PoseSettings = settings.mast if on_mast else settings.hand
    return Pose(
        "mast" if on_mast else "hand",
        rng.uniform(*ranges.height_m),
        rng.uniform(*ranges.pitch_deg),
        rng.uniform(*ranges.roll_deg),
        rng.uniform(0.0, 360.0),
    )


def random_view(rng: np.random.Generator, settings: CameraSettings, scene: Scene) -> View:
    """Draw a random view near the scene's centre, away from stems and obstacles."""
    feet = np.array([tree.position_m[:2] for tree in scene.near_trees]).reshape(-1, 2)
    things = scene.obstacles
    position = np.zeros(2)
    for _ in range(_ATTEMPTS):
        distance, angle = VIEW_RADIUS_M * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
        position = distance * heading(angle)
        beside = not len(feet) or np.hypot(*(feet - position).T).min() > _STEM_CLEARANCE_M
        gap_m = np.hypot(*(things[:, :2] - position).T) - things[:, 2]
        if beside and gap_m.min(initial=np.inf) > _STEM_CLEARANCE_M:
            break
    pose = _random_pose(rng, settings)
    height = float(scene.terrain.height_m(*position)) + pose.height_m
    return look_from(settings.intrinsics, np.array([*position, height]), pose)


def visible_faces(mesh: SceneMesh, view: View) -> Int64:
    """Faces of all instances whose bounding sphere intersects the view, nearest first.

    Returns:
        (n,) int64 face numbers.
    """
    local = view.to_camera(mesh.instance_centre)
    radius = mesh.instance_radius
    inside = local[:, 2] > -radius
    left, right, top, bottom = view.ray_bounds
    for axis, low, high in ((0, left, right), (1, top, bottom)):
        inside &= low * local[:, 2] - local[:, axis] < radius * np.hypot(1.0, low)
        inside &= local[:, axis] - high * local[:, 2] < radius * np.hypot(1.0, high)
    chosen = np.nonzero(inside)[0]
    nearness = np.linalg.norm(local[chosen], axis=1) - radius[chosen]
    chosen = chosen[np.argsort(nearness, kind="stable")]
    start = mesh.instance_start[chosen]
    count = mesh.instance_start[chosen + 1] - start
    shift = np.repeat(start - np.concatenate([[0], np.cumsum(count)[:-1]]), count)
    return np.asarray(np.arange(count.sum()) + shift)
