"""Camera and board poses from views of a board: bundle adjustment with honest uncertainties.

The steps are Levenberg and Marquardt's; the poses are eliminated view by view (Schur complement),
so that the time grows with the number of views and not with its cube. Hartley and Zisserman,
Multiple View Geometry, 2004, appendix 6.

Of two standard deviations the larger one is stated. One takes the points' errors as independent
(the same book, section 5.1.3). The other takes only the views as independent (Liang and Zeger,
Biometrika, 1986): the points of one view share its errors where the board is bent, the lens
refocused or the model too simple.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera import FISHEYE

Float = NDArray[np.floating[Any]]

PARAMETERS: Final = {
    "radtan": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
    "fisheye": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}
LENS_MODELS: Final = tuple(PARAMETERS)
_FIRST_FOCALS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0)
_STEPS, _POSE_STEPS, _SMALLEST_GAIN = 100, 5, 1e-9
_DAMPING, _MOST_DAMPING = 1e-3, 1e9
_LEAST_DETERMINED, _WIDEST = 1e-14, 1e3


@dataclass(frozen=True, eq=False)
class BoardView:
    """A board as one image shows it.

    ``image_px`` (N, 2) corner-based px and ``object_m`` (N, 3) metres on the board, z = 0, of the
    same points.
    """

    name: str
    image_px: Float
    object_m: Float


@dataclass(frozen=True, eq=False)
class Solution:
    """``intrinsics`` (P,) as ``PARAMETERS`` names them, ``poses`` (V, 6) rotation vector and
    metres, each taking board points to camera points; ``residuals_px`` one (N, 2) per view;
    ``stds`` (P,) of the intrinsics, None where the views do not determine them.
    """

    intrinsics: Float
    poses: Float
    residuals_px: tuple[Float, ...]
    stds: Float | None


def project(
    model: str, intrinsics: Float, pose: Float, object_m: Float
) -> tuple[Float, Float, Float]:
    """(N, 3) board points to (N, 2) px, centres on whole numbers, with the derivatives.

    Returns the px, (2N, P) by the intrinsics and (2N, 6) by the pose.
    """
    matrix = _matrix(intrinsics)
    points = np.ascontiguousarray(object_m, np.float64).reshape(-1, 1, 3)
    if model == FISHEYE:
        xy_px, slopes = cv2.fisheye.projectPoints(
            points, pose[:3], pose[3:], matrix, intrinsics[4:]
        )
        intrinsics_at, pose_at = slice(8), slice(8, 14)
    else:
        xy_px, slopes = cv2.projectPoints(points, pose[:3], pose[3:], matrix, intrinsics[4:])
        intrinsics_at, pose_at = slice(6, 6 + len(intrinsics)), slice(6)
    derivatives = np.asarray(slopes, np.float64)
    return (
        np.asarray(xy_px, np.float64).reshape(-1, 2),
        derivatives[:, intrinsics_at],
        derivatives[:, pose_at],
    )


def first_guess(
    views: Sequence[BoardView], size: tuple[int, int], model: str
) -> tuple[Float, list[Float | None]]:
    """Intrinsics (P,) and a pose of each view, if it has one, good enough to start from: of
    several focal lengths the one that explains the views best, without distortion.
    """
    width, height = size
    guesses = []
    for share in _FIRST_FOCALS:
        intrinsics = np.zeros(len(PARAMETERS[model]))
        intrinsics[:4] = share * max(size), share * max(size), (width - 1) / 2, (height - 1) / 2
        poses = [pose_of(view, intrinsics, model) for view in views]
        misses = [
            np.median(misses_px(view, model, intrinsics, pose))
            for view, pose in zip(views, poses, strict=True)
        ]
        guesses.append((float(np.median(misses)), intrinsics, poses))
    _, intrinsics, poses = min(guesses, key=lambda guess: guess[0])
    return intrinsics, poses


def misses_px(view: BoardView, model: str, intrinsics: Float, pose: Float | None) -> Float:
    """(N,) distances between a view's points and where the camera has them; infinite ones for a
    view without a pose.
    """
    if pose is None:
        return np.full(len(view.image_px), np.inf)
    xy_px = project(model, intrinsics, pose, view.object_m)[0]
    return np.asarray(np.linalg.norm(view.image_px - 0.5 - xy_px, axis=1))


def pose_of(view: BoardView, intrinsics: Float, model: str) -> Float | None:
    """(6,) pose of a board seen by a known camera; None where there is none.

    The closed form counts the points of a wide lens unevenly: a few steps in pixels follow, in
    which points beyond twice the median residual count linearly.
    """
    pose = _closed_form_pose(view, intrinsics, model)
    if pose is None:
        return None
    for _ in range(_POSE_STEPS):
        xy_px, _, by_pose = project(model, intrinsics, pose, view.object_m)
        pull = view.image_px - 0.5 - xy_px
        miss_px = np.linalg.norm(pull, axis=1)
        tolerance_px = 2 * np.median(miss_px) + 1e-9
        weight = np.sqrt(np.minimum(1.0, tolerance_px / np.maximum(miss_px, 1e-12)))
        step = np.linalg.lstsq(
            np.repeat(weight, 2)[:, None] * by_pose, (weight[:, None] * pull).ravel()
        )[0]
        moved = pose + step
        if not np.median(misses_px(view, model, intrinsics, moved)) < np.median(miss_px):
            break
        pose = moved
    return pose if pose[5] > 0 else None


def _closed_form_pose(view: BoardView, intrinsics: Float, model: str) -> Float | None:
    pixels = (view.image_px - 0.5).reshape(-1, 1, 2)
    undistort = cv2.fisheye.undistortPoints if model == FISHEYE else cv2.undistortPoints
    flat = undistort(pixels, _matrix(intrinsics), intrinsics[4:])
    if not (np.abs(flat) < _WIDEST).all():  # nor NaN, which undistorting gives beyond its reach
        return None
    found, rotation, translation_m = cv2.solvePnP(
        view.object_m, flat, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
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
    tolerance_px: float = np.inf,
) -> Solution:
    """The least-squares solution near these ``intrinsics`` (P,) and ``poses`` (V, 6); residuals
    beyond ``tolerance_px`` count linearly (Huber), so that wrong points pull less.
    """
    system = _System(views, model, intrinsics, poses, tolerance_px)
    damping = _DAMPING
    for _ in range(_STEPS):
        step = system.step(damping)
        if step is not None:
            tried = _System(views, model, intrinsics + step[0], poses + step[1], tolerance_px)
            if tried.cost < system.cost:
                gain = system.cost - tried.cost
                intrinsics, poses = intrinsics + step[0], poses + step[1]
                settled = gain < _SMALLEST_GAIN * system.cost
                system, damping = tried, damping / 10
                if settled:
                    break
                continue
        damping *= 10
        if damping > _MOST_DAMPING:
            break
    return Solution(intrinsics, poses, tuple(system.residuals), system.stds())


class _System:
    """The normal equations at one place: ``cost`` and, view by view, blocks of J^T J and J^T r."""

    def __init__(
        self,
        views: Sequence[BoardView],
        model: str,
        intrinsics: Float,
        poses: Float,
        tolerance_px: float,
    ) -> None:
        n = len(intrinsics)
        self.camera, self.camera_pulls = np.zeros((n, n)), np.zeros((len(views), n))
        self.both = np.zeros((len(views), n, 6))
        self.pose, self.pose_pull = np.zeros((len(views), 6, 6)), np.zeros((len(views), 6))
        self.cost = 0.0
        self.residuals: list[Float] = []
        with np.errstate(all="ignore"):
            for i, view in enumerate(views):
                xy_px, by_camera, by_pose = project(model, intrinsics, poses[i], view.object_m)
                residuals = view.image_px - 0.5 - xy_px
                self.residuals.append(residuals)
                miss_px = np.linalg.norm(residuals, axis=1)
                weights = np.minimum(1.0, tolerance_px / np.maximum(miss_px, 1e-12))
                self.cost += float(np.sum(weights * (2 - weights) * miss_px**2))
                weight = np.repeat(weights, 2)[:, None]
                pull = residuals.reshape(-1)
                self.camera += by_camera.T @ (weight * by_camera)
                self.camera_pulls[i] = (weight * by_camera).T @ pull
                self.both[i] = by_camera.T @ (weight * by_pose)
                self.pose[i] = by_pose.T @ (weight * by_pose)
                self.pose_pull[i] = (weight * by_pose).T @ pull
        if not np.isfinite(self.cost):
            self.cost = np.inf

    def step(self, damping: float) -> tuple[Float, Float] | None:
        """Of the intrinsics (P,) and the poses (V, 6); None where the equations give none."""
        camera = self.camera + damping * np.diag(np.diag(self.camera))
        pose = self.pose + damping * self.pose * np.eye(6)
        try:
            eliminated = self.both @ np.linalg.inv(pose)
            reduced = camera - np.einsum("vij,vkj->ik", eliminated, self.both)
            pull = self.camera_pulls.sum(0) - np.einsum("vij,vj->i", eliminated, self.pose_pull)
            intrinsics = np.linalg.solve(reduced, pull)
            rest = self.pose_pull - np.einsum("vij,i->vj", self.both, intrinsics)
            poses = np.linalg.solve(pose, rest[..., None])[..., 0]
        except np.linalg.LinAlgError:
            return None
        finite = np.isfinite(intrinsics).all() and np.isfinite(poses).all()
        return (intrinsics, poses) if finite else None

    def stds(self) -> Float | None:
        """(P,) of the intrinsics; None where the views say nothing of some direction."""
        views = len(self.residuals)
        freedom = 2 * sum(map(len, self.residuals)) - len(self.camera) - self.pose_pull.size
        try:
            eliminated = self.both @ np.linalg.inv(self.pose)
            reduced = self.camera - np.einsum("vij,vkj->ik", eliminated, self.both)
            known = np.diag(reduced)
            if freedom < 1 or not (known > 0).all():
                return None
            unit = reduced / np.sqrt(np.outer(known, known))
            if np.linalg.eigvalsh(unit)[0] < _LEAST_DETERMINED:
                return None
            inverse = np.linalg.inv(unit) / np.sqrt(np.outer(known, known))
        except np.linalg.LinAlgError:
            return None
        squared = sum(float(np.sum(residuals**2)) for residuals in self.residuals)
        by_points = np.diag(inverse) * squared / freedom
        pulls = self.camera_pulls - np.einsum("vij,vj->vi", eliminated, self.pose_pull)
        by_views = np.sum((pulls @ inverse) ** 2, axis=0) * views / (views - 1)
        return np.asarray(np.sqrt(np.maximum(by_points, by_views)))


def _matrix(intrinsics: Float) -> Float:
    fx, fy, cx, cy = intrinsics[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
