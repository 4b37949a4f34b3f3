"""The camera's motion between frames, from their depth images, with the package small_gicp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from basetree.arrays import Float
from basetree.errors import MissingPackage, install_hint
from calib import PinholeCamera, RigidTransform, pixels_to_rays
from edgetree.frames.frame import Frame

# Pixels of a depth image that are used, about: those at equal distances in rows and columns.
_PIXELS: Final = 7_000
# Depths used, m: nearer ones may be of the machine itself, those of cameras get too noisy beyond.
_NEAREST_M, _FARTHEST_M = 1.0, 12.0
# Points closer than this together become one.
_SPACING_M: Final = 0.1
_NEIGHBOURS: Final = 10
# Coarse to fine: spacing of the points, and how far apart matching points may be, m.
_COARSE_M, _COARSE_REACH_M, _REACH_M = 0.3, 1.5, 0.15
# A registration counts if so many points match, of so large a share of all.
_MIN_POINTS, _MIN_SHARE = 300, 0.3
# Largest chi-square, with six degrees of freedom, by which a step may differ from the expected one.
_GATE: Final = 28.0
# The reference is replaced after this way or turn, or when fewer points match.
_NEW_REFERENCE_M, _NEW_REFERENCE_RAD, _NEW_REFERENCE_SHARE = 0.3, 0.1, 0.6
# Surfaces must face every way: the smallest eigenvalue of the normals' mean outer product. Level
# ground alone has up to 0.004, one stem on it 0.013, simulated forests 0.07 and more.
_MIN_FACING: Final = 0.01
# Standard deviation of a point along its normal, m, if all points match: points of one surface
# share errors. Where fewer match, as among leaves, it grows by the share to this power. With both,
# errors on simulated drives are as large as stated. Smallest deviations of a step: m, rad.
_POINT_STD_M, _SHARE_POWER, _MIN_STD_M, _MIN_STD_RAD = 0.12, -2.0, 0.005, 0.002
# Standard deviation of the camera's roll and pitch between frames, rad per square root of a second.
_TILT_RAD: Final = 0.2


@dataclass(frozen=True, eq=False)
class CameraStep:
    """How the camera moved between two frames.

    Attributes:
        transform: From the camera's frame now to its frame before.
        covariance: (6, 6) of the error of turn (rad) and shift (m), in the camera's frame now.
    """

    transform: RigidTransform
    covariance: Float

    def in_level(self, before: Float, now: Float) -> tuple[RigidTransform, Float]:
        """The step between the level frames.

        Args:
            before: (3, 3) rotation from the camera's frame before to the level frame before.
            now: The same for the frame now.

        Returns:
            The transform from the level frame now to the one before, and the (4, 4) covariance of
            the error of its shift in x, y and z, m, and of its turn about the vertical, rad.
        """
        turn = before @ self.transform.rotation
        error = np.zeros((4, 6))
        error[:3, 3:], error[3, :3] = turn, turn[2]
        shift = before @ self.transform.translation_m
        return RigidTransform(turn @ now.T, shift), error @ self.covariance @ error.T

    @classmethod
    def from_level(
        cls, step: RigidTransform, covariance: Float, before: Float, now: Float, step_s: float
    ) -> CameraStep:
        """The step from that between the level frames, the reverse of `in_level`.

        Args:
            step: Transform from the level frame now to the one before.
            covariance: (4, 4) of the error of its shift in x, y and z, m, and of its turn, rad.
            before: (3, 3) rotation from the camera's frame before to the level frame before.
            now: The same for the frame now.
            step_s: Time that it takes, for the error of roll and pitch.
        """
        transform = RigidTransform(before.T @ step.rotation @ now, before.T @ step.translation_m)
        turn = before @ transform.rotation
        error = np.zeros((6, 4))
        error[3:, :3], error[:3, 3] = turn.T, turn[2]
        tilt = np.zeros((6, 6))
        tilt[:3, :3] = _TILT_RAD**2 * step_s * np.eye(3)
        return cls(transform, error @ covariance @ error.T + tilt)

    def agrees(self, other: CameraStep) -> bool:
        """Whether another estimate of the same step differs by no more than both state."""
        off = other.transform.then(self.transform.inverse())
        turn = off.rotation - off.rotation.T
        by = np.array([turn[2, 1], turn[0, 2], turn[1, 0], *(2 * off.translation_m)]) / 2
        return bool(by @ np.linalg.solve(self.covariance + other.covariance, by) < _GATE)


class DepthOdometry:
    """Finds the camera's motion by registering each depth image with an earlier one.

    The earlier image, the reference, stays the same until the camera has moved away from it, so
    that errors do not add up while the machine stands. Generalized ICP (Segal et al. 2009),
    as in small_gicp (Koide 2024), first on a coarse, then on a fine set of points.

    Raises:
        MissingPackage: small_gicp is not installed.
    """

    def __init__(self) -> None:
        try:
            import small_gicp
        except ImportError as error:
            raise MissingPackage(
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

    def step(self, frame: Frame, guess: CameraStep | None) -> CameraStep | None:
        """Find how the camera moved since the last frame.

        The frame's points are registered with those of the reference, from the guess on. The step
        counts if enough points match and it does not contradict the guess; if not, the frame is the
        next reference. It is so, too, when the camera has moved away from the last one.

        Args:
            frame: The frame; its depth and camera are used.
            guess: The expected step; None if nothing is known. One that differs by more than its
                covariance explains is not believed.

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
        expected = before if guess is None else guess.transform.then(before)
        found = reference.register(cloud, expected)
        if found is None:
            self._use(cloud)
            return None
        now, covariance, share = found
        step = CameraStep(now.then(before.inverse()), covariance)
        if guess is not None and not guess.agrees(step):
            self._use(cloud)
            return None
        moved = np.linalg.norm(now.translation_m) > _NEW_REFERENCE_M
        turned = _angle_rad(now.rotation) > _NEW_REFERENCE_RAD
        if moved or turned or share < _NEW_REFERENCE_SHARE:
            self._use(cloud)
        else:
            self._since = now
        return step

    def _use(self, cloud: _Cloud) -> None:
        """Make a cloud the reference."""
        self._reference, self._since = cloud, RigidTransform.identity()

    def _points(self, frame: Frame) -> Float:
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
        covariance = other.covariance(share)
        if covariance is None:
            return None
        found = result.T_target_source
        return RigidTransform(found[:3, :3], found[:3, 3]), covariance, share

    def covariance(self, share: float) -> Float | None:
        """(6, 6) of turn and shift when a share of its points match; None if they leave it loose.

        The covariance that generalized ICP states counts points of level ground as knowledge of
        shifts along the ground, which they are not.
        """
        points = np.asarray(self._fine[0].points())[:, :3]
        normals = np.asarray(self._fine[0].normals())[:, :3]
        if np.linalg.eigvalsh(normals.T @ normals)[0] < _MIN_FACING * len(normals):
            return None
        jacobian = np.hstack([np.cross(points, normals), normals])
        std_m = _POINT_STD_M * share**_SHARE_POWER
        by_planes = np.linalg.inv(jacobian.T @ jacobian) * std_m**2
        return np.asarray(by_planes + np.diag([_MIN_STD_RAD**2] * 3 + [_MIN_STD_M**2] * 3))

    def _aligned(self, target: Any, source: Any, start: Float, reach_m: float) -> Any:
        (points, tree), (moving, _) = target, source
        return self._gicp.align(
            points, moving, tree, start, "GICP", max_correspondence_distance=reach_m
        )


def _angle_rad(rotation: Float) -> float:
    return float(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1)))
