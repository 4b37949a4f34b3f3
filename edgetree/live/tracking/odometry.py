"""The camera's motion between frames, from their depth images, with the package small_gicp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera, RigidTransform, pixels_to_rays
from edgetree.errors import MissingDependency, install_hint
from edgetree.live.frames import LiveFrame

__all__ = ["CameraStep", "DepthOdometry", "from_level"]

Float = NDArray[np.floating[Any]]

# Every so manieth pixel is used that some 14,000 of an image are left.
_PIXELS: Final = 14_000
# Depths used, m: nearer ones may be of the machine itself, those of cameras get too noisy beyond.
_NEAREST_M, _FARTHEST_M = 1.0, 12.0
# Points closer than this together become one.
_SPACING_M: Final = 0.1
_NEIGHBOURS: Final = 10
# Coarse to fine: spacing of the points, and how far apart matching points may be, m.
_COARSE_M, _COARSE_REACH_M, _REACH_M = 0.3, 1.5, 0.3
# A registration counts if so many points match, of so large a share of all.
_MIN_POINTS, _MIN_SHARE = 300, 0.5
# The reference is replaced after this way or turn, or when fewer points match.
_NEW_REFERENCE_M, _NEW_REFERENCE_RAD, _NEW_REFERENCE_SHARE = 0.3, 0.1, 0.75
# Surfaces must face every way: the smallest eigenvalue of the normals' mean outer product. Level
# ground alone has up to 0.004, one stem on it 0.013, simulated forests 0.07 and more.
_MIN_FACING: Final = 0.01
# Standard deviation of a point along its normal, m: points of one surface share errors. Smallest
# standard deviations of a step: m, rad.
_POINT_STD_M, _MIN_STD_M, _MIN_STD_RAD = 0.1, 0.005, 0.001


@dataclass(frozen=True, eq=False)
class CameraStep:
    """How the camera moved between two frames.

    Attributes:
        transform: from the camera's frame now to its frame before.
        covariance: (6, 6) of the error of turn (rad) and shift (m), in the camera's frame now.
    """

    transform: RigidTransform
    covariance: Float

    def in_level(self, before: Float, now: Float) -> tuple[RigidTransform, Float]:
        """The step between the level frames.

        Args:
            before: (3, 3) rotation from the camera's frame before to the level frame before.
            now: the same for the frame now.

        Returns:
            The transform from the level frame now to the one before, and the (4, 4) covariance of
            the error of its shift in x, y and z, m, and of its turn about the vertical, rad.
        """
        turn = before @ self.transform.rotation
        error = np.zeros((4, 6))
        error[:3, 3:], error[3, :3] = turn, turn[2]
        shift = before @ self.transform.translation_m
        return RigidTransform(turn @ now.T, shift), error @ self.covariance @ error.T


def from_level(step: RigidTransform, before: Float, now: Float) -> RigidTransform:
    """The step between the camera's frames from that between the level frames, as `in_level`."""
    return RigidTransform(before.T @ step.rotation @ now, before.T @ step.translation_m)


class DepthOdometry:
    """Finds the camera's motion by registering each depth image with an earlier one.

    The earlier image, the reference, stays the same until the camera has moved away from it, so
    that errors do not add up while the machine stands. Generalized ICP (Segal et al. 2009),
    as in small_gicp (Koide 2024), first on a coarse, then on a fine set of points.

    Raises:
        MissingDependency: small_gicp is not installed.
    """

    def __init__(self) -> None:
        try:
            import small_gicp
        except ImportError as error:
            raise MissingDependency(
                f"motion from depth needs the package small_gicp: {install_hint('odometry')}"
            ) from error
        self._gicp = small_gicp
        self._camera: PinholeCamera | None = None
        self._rays: Float = np.zeros((0, 0, 3))
        self.restart()

    def restart(self) -> None:
        """Forget the frames so far, as after a jump of the clock."""
        self._reference: _Cloud | None = None
        self._since = RigidTransform.identity()

    def step(self, frame: LiveFrame, guess: RigidTransform | None) -> CameraStep | None:
        """Find how the camera moved since the last frame.

        Args:
            frame: the frame; its depth and camera are used.
            guess: the expected transform from the camera's frame now to its frame before; None if
                nothing is known.

        Returns:
            The motion; None for the first frame, without depth, and where the images do not tell.
        """
        points_m = self._points(frame)
        if len(points_m) < _MIN_POINTS:
            self.restart()
            return None
        cloud = _Cloud(self._gicp, points_m)
        reference, before = self._reference, self._since
        if reference is None:
            self._use(cloud)
            return None
        expected = before if guess is None else guess.then(before)
        found = reference.register(cloud, expected)
        if found is None:
            self._use(cloud)
            return None
        now, covariance, share = found
        moved = np.linalg.norm(now.translation_m) > _NEW_REFERENCE_M
        turned = _angle_rad(now.rotation) > _NEW_REFERENCE_RAD
        if moved or turned or share < _NEW_REFERENCE_SHARE:
            self._use(cloud)
        else:
            self._since = now
        return CameraStep(now.then(before.inverse()), covariance)

    def _use(self, cloud: _Cloud) -> None:
        """Make a cloud the reference."""
        self._reference, self._since = cloud, RigidTransform.identity()

    def _points(self, frame: LiveFrame) -> Float:
        """(N, 3) points of a frame in metres, from pixels at equal distances."""
        if frame.depth_m is None or frame.camera is None or frame.depth_fault is not None:
            return np.zeros((0, 3))
        height, width = frame.depth_m.shape
        stride = max(1, round((height * width / _PIXELS) ** 0.5))
        every = slice(stride // 2, None, stride)
        depth_m = frame.depth_m[every, every].astype(np.float64)
        if frame.camera != self._camera or self._rays.shape[:2] != depth_m.shape:
            rows, columns = np.mgrid[:height, :width][:, every, every]
            self._rays = pixels_to_rays(frame.camera, np.stack([columns, rows], -1) + 0.5)
            self._camera = frame.camera
        usable = (depth_m > _NEAREST_M) & (depth_m < _FARTHEST_M)
        return np.asarray(self._rays[usable] * depth_m[usable][:, None])


class _Cloud:
    """The points of a frame at two spacings, with their search trees and covariances."""

    def __init__(self, gicp: Any, points_m: Float) -> None:
        self._gicp = gicp
        self._fine = gicp.preprocess_points(points_m, _SPACING_M, _NEIGHBOURS)
        self._coarse = gicp.preprocess_points(self._fine[0], _COARSE_M, _NEIGHBOURS)

    def register(
        self, other: _Cloud, expected: RigidTransform
    ) -> tuple[RigidTransform, Float, float] | None:
        """Register another cloud with this one.

        Returns:
            The transform from the other's frame to this one's, the covariance of turn and shift,
            and the share of matching points; None if they do not match.
        """
        start = np.eye(4)
        start[:3, :3], start[:3, 3] = expected.rotation, expected.translation_m
        rough = self._aligned(self._coarse, other._coarse, start, _COARSE_REACH_M)
        result = self._aligned(self._fine, other._fine, rough.T_target_source, _REACH_M)
        share = result.num_inliers / max(other._fine[0].size(), 1)
        if result.num_inliers < _MIN_POINTS or share < _MIN_SHARE:
            return None
        covariance = other.covariance()
        if covariance is None:
            return None
        found = result.T_target_source
        return RigidTransform(found[:3, :3], found[:3, 3]), covariance, share

    def covariance(self) -> Float | None:
        """(6, 6) of turn and shift when registered by its planes; None if they leave it loose.

        The covariance that generalized ICP states counts points of level ground as knowledge of
        shifts along the ground, which they are not.
        """
        points = np.asarray(self._fine[0].points())[:, :3]
        normals = np.asarray(self._fine[0].normals())[:, :3]
        if np.linalg.eigvalsh(normals.T @ normals)[0] < _MIN_FACING * len(normals):
            return None
        jacobian = np.hstack([np.cross(points, normals), normals])
        covariance = np.linalg.inv(jacobian.T @ jacobian) * _POINT_STD_M**2
        return covariance + np.diag([_MIN_STD_RAD**2] * 3 + [_MIN_STD_M**2] * 3)

    def _aligned(self, target: Any, source: Any, start: Float, reach_m: float) -> Any:
        (points, tree), (moving, _) = target, source
        return self._gicp.align(
            points, moving, tree, start, "GICP", max_correspondence_distance=reach_m
        )


def _angle_rad(rotation: Float) -> float:
    return float(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1)))
