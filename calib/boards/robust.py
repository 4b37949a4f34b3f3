"""Robust calibration: find, name and leave out wrong views and points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from basetree.arrays import Bool, Float
from calib.boards.corners import LEAST_POINTS
from calib.boards.result import Dropped
from calib.boards.solve import (
    BoardView,
    Solution,
    estimate_pose,
    initial_estimate,
    refine,
    residual_lengths_px,
)

_MAX_ROUNDS: Final = 15
# In units of the typical view's median residual.
_HUBER_FACTOR, _VIEW_FACTOR, _POINT_FACTOR = 2.0, 3.0, 5.0
_MIN_LIMIT_PX = 0.3
_MEDIAN_LENGTH: Final = 1.1774  # of a vector of two normal errors of 1: sqrt(2 ln 2)
_MAX_SHARE_OF_WRONG_POINTS = 0.3


@dataclass(frozen=True, eq=False)
class _ViewCheck:
    """Which points of a view agree with the other views (none if the view does not), and why."""

    right: Bool
    reason: str

    @property
    def kept(self) -> bool:
        return bool(self.right.any())


def solve_robustly(
    views: Sequence[BoardView], size: tuple[int, int], model: str, min_views: int
) -> tuple[list[BoardView], Solution | None, list[Dropped]]:
    """Solve by least squares with wrong views and points left out.

    A view is left out if its median residual exceeds 3 times that of the typical view, a point if
    its residual exceeds 5 times that. Every round tests all views and points again with the camera
    fitted to those kept in the round before. During the rounds, residuals beyond twice the typical
    one have linear weight (Huber); the final solution is plain least squares.

    Args:
        views: Points of the board in each image.
        size: Width and height of the images in px.
        model: "radtan" or "fisheye".
        min_views: Smallest number of views to solve with.

    Returns:
        The views used, without wrong points and on the board's own shape; the solution, None if
        fewer than `min_views` are left; and what was left out.
    """
    intrinsics, poses = initial_estimate(views, size, model)
    before: list[_ViewCheck] = []
    shaped = list(views)
    for _ in range(_MAX_ROUNDS):
        residuals_px = [
            residual_lengths_px(view, model, intrinsics, pose)
            for view, pose in zip(shaped, poses, strict=True)
        ]
        typical_px = float(np.median([np.median(residual_px) for residual_px in residuals_px]))
        checks = [_check_view(residual_px, typical_px) for residual_px in residuals_px]
        kept = [i for i, check in enumerate(checks) if check.kept]
        if len(kept) < min_views:
            return [views[i] for i in kept], None, _dropped(views, checks)
        subset = [_part(views[i], checks[i].right) for i in kept]
        start = np.array([poses[i] for i in kept])
        noise_px = typical_px / _MEDIAN_LENGTH
        if [list(v.right) for v in before] == [list(v.right) for v in checks]:
            break
        tolerance_px = max(_HUBER_FACTOR * typical_px, _MIN_LIMIT_PX)
        solution = refine(subset, model, intrinsics, start, noise_px, tolerance_px)
        shaped = solution.bent(views)
        intrinsics, before = solution.intrinsics, checks
        refined = dict(zip(kept, solution.poses, strict=True))
        poses = [
            _better_pose(view, model, intrinsics, refined.get(i)) for i, view in enumerate(shaped)
        ]
    solution = refine(subset, model, intrinsics, start, noise_px)
    return solution.bent(subset), solution, _dropped(views, checks)


def _check_view(residual_px: Float, typical_px: float) -> _ViewCheck:
    view_limit_px = max(_VIEW_FACTOR * typical_px, _MIN_LIMIT_PX)
    point_limit_px = max(_POINT_FACTOR * typical_px, _MIN_LIMIT_PX)
    nothing = np.zeros(len(residual_px), bool)
    median_px = float(np.median(residual_px))
    if not np.isfinite(median_px):
        return _ViewCheck(nothing, "no pose of the board fits its points")
    if median_px > view_limit_px:
        return _ViewCheck(
            nothing,
            f"its median residual is {median_px:.2g} px, expected {view_limit_px:.2g} or less",
        )
    right = residual_px <= point_limit_px
    wrong = len(right) - int(right.sum())
    if len(right) - wrong < LEAST_POINTS or wrong > _MAX_SHARE_OF_WRONG_POINTS * len(right):
        return _ViewCheck(
            nothing,
            f"{wrong} of its {len(right)} points are off by more than {point_limit_px:.2g} px",
        )
    return _ViewCheck(
        right, f"residuals up to {residual_px.max():.2g} px, expected {point_limit_px:.2g} or less"
    )


def _better_pose(
    view: BoardView, model: str, intrinsics: Float, refined: Float | None
) -> Float | None:
    """Return the refined pose, or a newly estimated one if it fits better.

    A flat board seen nearly from the front has two plausible poses, and refinement does not move
    from one to the other.
    """
    anew = estimate_pose(view, intrinsics, model)
    if refined is None or anew is None:
        return anew if refined is None else refined
    anew_px = float(np.median(residual_lengths_px(view, model, intrinsics, anew)))
    return (
        anew
        if anew_px < np.median(residual_lengths_px(view, model, intrinsics, refined))
        else refined
    )


def _part(view: BoardView, right: Bool) -> BoardView:
    return BoardView(view.name, view.image_px[right], view.object_m[right])


def _dropped(views: Sequence[BoardView], checks: Sequence[_ViewCheck]) -> list[Dropped]:
    return [
        Dropped(
            view.name,
            tuple(int(i) for i in np.flatnonzero(~check.right)) if check.kept else (),
            check.reason,
        )
        for view, check in zip(views, checks, strict=True)
        if not check.right.all()
    ]
