"""Bundle adjustment of a camera and board poses, with standard deviations.

Levenberg-Marquardt steps; the poses are eliminated view by view (Schur complement), so the time
grows linearly with the number of views. Hartley and Zisserman, Multiple View Geometry, 2004,
appendix 6.

Each standard deviation is the larger of two estimates. One treats the errors of all points as
independent (Hartley and Zisserman, section 5.1.3). The other treats only the views as independent
(Liang and Zeger, Biometrika, 1986), because refocusing or a distortion model that is too simple
gives all points of a view correlated errors. The board's own shape is estimated too
(`calib.boards.shape`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from basetree.arrays import Float
from calib.boards.shape import COUNT, PRIOR_STDS, BoardFrame, frame_of
from calib.distortion import FISHEYE

PARAMETERS: Final = {
    "radtan": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
    "fisheye": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}
LENS_MODELS: Final = tuple(PARAMETERS)
_INITIAL_FOCALS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0)  # relative to the longer side
_MAX_STEPS, _POSE_STEPS, _MIN_RELATIVE_GAIN = 100, 5, 1e-9
_INITIAL_DAMPING, _MAX_DAMPING = 1e-3, 1e9
_MIN_EIGENVALUE, _MAX_NORMALISED = 1e-14, 1e3


@dataclass(frozen=True, eq=False)
class BoardView:
    """Points of a board in one image.

    Attributes:
        name: Name of the image.
        image_px: (N, 2) continuous px.
        object_m: (N, 3) metres on the board of the same points; z = 0 on a flat board.
    """

    name: str
    image_px: Float
    object_m: Float


@dataclass(frozen=True, eq=False)
class Solution:
    """A camera and board poses.

    Attributes:
        intrinsics: (P,) in the order of `PARAMETERS`.
        poses: (V, 6) rotation vector and translation in metres, board to camera coordinates.
        residuals_px: (N, 2) observed minus projected px of each view.
        stds: (P,) standard deviations of the intrinsics; None if the views do not determine them.
        frame: The board as it was meant to be.
        shape: (K,) how it differs, in the terms of `BoardFrame.basis_m`.
        shape_covariance: (K, K) of the errors of `shape`; None if `stds` is.
    """

    intrinsics: Float
    poses: Float
    residuals_px: tuple[Float, ...]
    stds: Float | None
    frame: BoardFrame
    shape: Float
    shape_covariance: Float | None

    def bent(self, views: Sequence[BoardView]) -> list[BoardView]:
        """Return views with the points where they are on the board as it is."""
        return [
            replace(v, object_m=v.object_m + self.frame.basis_m(v.object_m) @ self.shape)
            for v in views
        ]


def project(
    model: str, intrinsics: Float, pose: Float, object_m: Float
) -> tuple[Float, Float, Float]:
    """Project board points, with derivatives.

    Args:
        model: "radtan" or "fisheye".
        intrinsics: (P,) in the order of `PARAMETERS`.
        pose: (6,) rotation vector and translation in metres.
        object_m: (N, 3) metres on the board.

    Returns:
        (N, 2) px in OpenCV's convention, and their derivatives with respect to the intrinsics, (2N,
        P), and the pose, (2N, 6).
    """
    matrix = _matrix(intrinsics)
    points = np.ascontiguousarray(object_m, np.float64).reshape(-1, 1, 3)
    if model == FISHEYE:
        xy_px, jacobian = cv2.fisheye.projectPoints(
            points, pose[:3], pose[3:], matrix, intrinsics[4:]
        )
        intrinsics_at, pose_at = slice(8), slice(8, 14)
    else:
        xy_px, jacobian = cv2.projectPoints(points, pose[:3], pose[3:], matrix, intrinsics[4:])
        intrinsics_at, pose_at = slice(6, 6 + len(intrinsics)), slice(6)
    derivatives = np.asarray(jacobian, np.float64)
    return (
        np.asarray(xy_px, np.float64).reshape(-1, 2),
        derivatives[:, intrinsics_at],
        derivatives[:, pose_at],
    )


def shape_derivatives(by_pose: Float, pose: Float, basis_m: Float) -> Float:
    """Return the (2N, K) derivatives of `project` with respect to the terms of the board's shape.

    Args:
        by_pose: (2N, 6) derivatives with respect to the pose.
        pose: (6,) rotation vector and translation in metres.
        basis_m: (N, 3, K) from `BoardFrame.basis_m`.
    """
    turned_m = cv2.Rodrigues(pose[:3])[0] @ basis_m
    return np.asarray((by_pose[:, 3:].reshape(-1, 2, 3) @ turned_m).reshape(-1, COUNT))


def initial_estimate(
    views: Sequence[BoardView], size: tuple[int, int], model: str
) -> tuple[Float, list[Float | None]]:
    """Estimate starting values: the best of several focal lengths, without distortion.

    Args:
        views: Points of the board in each image.
        size: Width and height of the images in px.
        model: "radtan" or "fisheye".

    Returns:
        Intrinsics (P,), and the (6,) pose of each view, None for views without one.
    """
    width, height = size
    guesses = []
    for share in _INITIAL_FOCALS:
        intrinsics = np.zeros(len(PARAMETERS[model]))
        intrinsics[:4] = share * max(size), share * max(size), (width - 1) / 2, (height - 1) / 2
        poses = [estimate_pose(view, intrinsics, model) for view in views]
        medians_px = [
            np.median(residual_lengths_px(view, model, intrinsics, pose))
            for view, pose in zip(views, poses, strict=True)
        ]
        guesses.append((float(np.median(medians_px)), intrinsics, poses))
    _, intrinsics, poses = min(guesses, key=lambda guess: guess[0])
    return intrinsics, poses


def residual_lengths_px(
    view: BoardView, model: str, intrinsics: Float, pose: Float | None
) -> Float:
    """Return the (N,) reprojection errors of a view; infinite for a view without a pose."""
    if pose is None:
        return np.full(len(view.image_px), np.inf)
    xy_px = project(model, intrinsics, pose, view.object_m)[0]
    return np.asarray(np.linalg.norm(view.image_px - 0.5 - xy_px, axis=1))


def estimate_pose(view: BoardView, intrinsics: Float, model: str) -> Float | None:
    """Estimate the pose of a board seen by a known camera.

    A closed-form solution, which weights the points of a wide-angle lens unevenly, is refined by a
    few Gauss-Newton steps on the reprojection errors. Errors beyond twice the median have linear
    weight (Huber).

    Returns:
        (6,) rotation vector and translation in metres; None if no pose was found.
    """
    pose = _closed_form_pose(view, intrinsics, model)
    if pose is None:
        return None
    for _ in range(_POSE_STEPS):
        xy_px, _, by_pose = project(model, intrinsics, pose, view.object_m)
        residual = view.image_px - 0.5 - xy_px
        lengths_px = np.linalg.norm(residual, axis=1)
        tolerance_px = 2 * np.median(lengths_px) + 1e-9
        weight = np.sqrt(np.minimum(1.0, tolerance_px / np.maximum(lengths_px, 1e-12)))
        step = np.linalg.lstsq(
            np.repeat(weight, 2)[:, None] * by_pose, (weight[:, None] * residual).ravel()
        )[0]
        moved = pose + step
        if not np.median(residual_lengths_px(view, model, intrinsics, moved)) < np.median(
            lengths_px
        ):
            break
        pose = moved
    return pose if pose[5] > 0 else None


def _closed_form_pose(view: BoardView, intrinsics: Float, model: str) -> Float | None:
    pixels = (view.image_px - 0.5).reshape(-1, 1, 2)
    undistort = cv2.fisheye.undistortPoints if model == FISHEYE else cv2.undistortPoints
    flat = undistort(pixels, _matrix(intrinsics), intrinsics[4:])
    # NaN, which points outside the model's range become, fails this test, too.
    if not (np.abs(flat) < _MAX_NORMALISED).all():
        return None
    found, rotation, translation_m = cv2.solvePnP(
        view.object_m * (1.0, 1.0, 0.0), flat, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    if not found:
        return None
    pose = np.concatenate([rotation.ravel(), translation_m.ravel()])
    return pose if np.isfinite(pose).all() and pose[5] > 0 else None


def refine(
    views: Sequence[BoardView],
    model: str,
    intrinsics: Float,
    poses: Float,
    noise_px: float,
    tolerance_px: float = np.inf,
) -> Solution:
    """Minimise the squared reprojection errors over camera, poses and the board's shape.

    Args:
        views: Points of the flat board in each image.
        model: "radtan" or "fisheye".
        intrinsics: (P,) starting values.
        poses: (V, 6) starting values.
        noise_px: Error of a coordinate, against which the prior of the shape is weighed.
        tolerance_px: Residuals beyond this have linear weight (Huber loss).
    """
    board = _Board(views, noise_px)
    shared = np.concatenate([intrinsics, np.zeros(COUNT)])
    system = _NormalEquations(board, model, shared, poses, tolerance_px)
    damping = _INITIAL_DAMPING
    for _ in range(_MAX_STEPS):
        step = system.step(damping)
        if step is not None:
            candidate = _NormalEquations(
                board, model, shared + step[0], poses + step[1], tolerance_px
            )
            if candidate.cost < system.cost:
                gain = system.cost - candidate.cost
                shared, poses = shared + step[0], poses + step[1]
                converged = gain < _MIN_RELATIVE_GAIN * system.cost
                system, damping = candidate, damping / 10
                if converged:
                    break
                continue
        damping *= 10
        if damping > _MAX_DAMPING:
            break
    intrinsics, shape = shared[:-COUNT], shared[-COUNT:]
    covariance = system.covariance()
    stds = None if covariance is None else np.sqrt(np.diag(covariance)[:-COUNT])
    of_shape = None if covariance is None else covariance[-COUNT:, -COUNT:]
    residuals_px = tuple(system.residuals)
    return Solution(intrinsics, poses, residuals_px, stds, board.frame, shape, of_shape)


class _Board:
    """The views, how the board's shape moves their points, and the prior of the shape."""

    def __init__(self, views: Sequence[BoardView], noise_px: float) -> None:
        self.views = views
        self.frame = frame_of([view.object_m for view in views])
        self.bases_m = [self.frame.basis_m(view.object_m) for view in views]
        self.prior = np.square(noise_px / PRIOR_STDS)


class _NormalEquations:
    """The normal equations of one linearisation.

    Holds the `cost` and, view by view, the blocks of J^T J and J^T r.
    """

    def __init__(
        self,
        board: _Board,
        model: str,
        shared: Float,
        poses: Float,
        tolerance_px: float,
    ) -> None:
        views, n = board.views, len(shared)
        intrinsics, shape = shared[:-COUNT], shared[-COUNT:]
        self.camera, self.camera_gradients = np.zeros((n, n)), np.zeros((len(views), n))
        self.both = np.zeros((len(views), n, 6))
        self.pose, self.pose_gradient = np.zeros((len(views), 6, 6)), np.zeros((len(views), 6))
        self.cost = 0.0
        self.residuals: list[Float] = []
        with np.errstate(all="ignore"):
            for i, view in enumerate(views):
                basis_m = board.bases_m[i]
                object_m = view.object_m + basis_m @ shape
                xy_px, by_intrinsics, by_pose = project(model, intrinsics, poses[i], object_m)
                by_camera = np.hstack(
                    [by_intrinsics, shape_derivatives(by_pose, poses[i], basis_m)]
                )
                residuals = view.image_px - 0.5 - xy_px
                self.residuals.append(residuals)
                lengths_px = np.linalg.norm(residuals, axis=1)
                weights = np.minimum(1.0, tolerance_px / np.maximum(lengths_px, 1e-12))
                self.cost += float(np.sum(weights * (2 - weights) * lengths_px**2))
                weight = np.repeat(weights, 2)[:, None]
                residual = residuals.reshape(-1)
                self.camera += by_camera.T @ (weight * by_camera)
                self.camera_gradients[i] = (weight * by_camera).T @ residual
                self.both[i] = by_camera.T @ (weight * by_pose)
                self.pose[i] = by_pose.T @ (weight * by_pose)
                self.pose_gradient[i] = (weight * by_pose).T @ residual
        self.prior_gradient = np.concatenate([0 * intrinsics, -board.prior * shape])
        self.cost += float(np.sum(board.prior * shape**2))
        self.camera[range(n - COUNT, n), range(n - COUNT, n)] += board.prior
        if not np.isfinite(self.cost):
            self.cost = np.inf

    def step(self, damping: float) -> tuple[Float, Float] | None:
        """Return the steps of intrinsics and shape (P + K,) and poses (V, 6); None if singular."""
        camera = self.camera + damping * np.diag(np.diag(self.camera))
        pose = self.pose + damping * self.pose * np.eye(6)
        try:
            eliminated = self.both @ np.linalg.inv(pose)
            reduced = camera - np.einsum("vij,vkj->ik", eliminated, self.both)
            gradient = self.camera_gradients.sum(0) + self.prior_gradient
            gradient -= np.einsum("vij,vj->i", eliminated, self.pose_gradient)
            shared = np.linalg.solve(reduced, gradient)
            rest = self.pose_gradient - np.einsum("vij,i->vj", self.both, shared)
            poses = np.linalg.solve(pose, rest[..., None])[..., 0]
        except np.linalg.LinAlgError:
            return None
        finite = np.isfinite(shared).all() and np.isfinite(poses).all()
        return (shared, poses) if finite else None

    def covariance(self) -> Float | None:
        """Return the (P + K, P + K) covariance of intrinsics and shape; None if undetermined."""
        views = len(self.residuals)
        degrees_of_freedom = (
            2 * sum(map(len, self.residuals)) - len(self.camera) - self.pose_gradient.size
        )
        try:
            eliminated = self.both @ np.linalg.inv(self.pose)
            reduced = self.camera - np.einsum("vij,vkj->ik", eliminated, self.both)
            information = np.diag(reduced)
            if degrees_of_freedom < 1 or not (information > 0).all():
                return None
            unit = reduced / np.sqrt(np.outer(information, information))
            if np.linalg.eigvalsh(unit)[0] < _MIN_EIGENVALUE:
                return None
            inverse = np.linalg.inv(unit) / np.sqrt(np.outer(information, information))
        except np.linalg.LinAlgError:
            return None
        squared_px2 = sum(float(np.sum(residuals**2)) for residuals in self.residuals)
        by_points = inverse * squared_px2 / degrees_of_freedom
        gradients = self.camera_gradients - np.einsum("vij,vj->vi", eliminated, self.pose_gradient)
        by_views = np.sum((gradients @ inverse) ** 2, axis=0) * views / (views - 1)
        variances = np.diag(by_points)
        larger = np.sqrt(np.maximum(variances, by_views) / variances)
        return np.asarray(by_points * np.outer(larger, larger))


def _matrix(intrinsics: Float) -> Float:
    fx, fy, cx, cy = intrinsics[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
