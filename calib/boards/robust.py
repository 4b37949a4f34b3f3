"""Solving with some views and points wrong: they are found, named and left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from calib.boards.board import LEAST_POINTS
from calib.boards.result import Dropped
from calib.boards.solve import BoardView, Solution, first_guess, misses_px, pose_of, refine

Float = NDArray[np.floating[Any]]

_ROUNDS: Final = 15
_LINEAR_BEYOND, _VIEW_LIMIT, _POINT_LIMIT = 2.0, 3.0, 5.0
_NEVER_BELOW_PX = 0.3
_MOST_POINTS_LOST = 0.3


@dataclass(frozen=True, eq=False)
class _Verdict:
    """Which points of a view agree with the others, none of a view that does not; and why."""

    right: NDArray[np.bool_]
    reason: str

    @property
    def kept(self) -> bool:
        return bool(self.right.any())


def solve_robustly(
    views: Sequence[BoardView], size: tuple[int, int], model: str, least_views: int
) -> tuple[list[BoardView], Solution | None, list[Dropped]]:
    """The least-squares solution of the views and points that agree, with what was left out.

    A view goes where its median residual is 3 times that of the typical view, a point where its
    residual is 5 times as large. Each round tries all of them anew against what those that agreed
    in the last one say; residuals beyond twice the typical one count linearly until that settles.
    No solution where fewer than ``least_views`` agree.
    """
    intrinsics, poses = first_guess(views, size, model)
    before: list[_Verdict] = []
    for _ in range(_ROUNDS):
        misses = [
            misses_px(view, model, intrinsics, pose)
            for view, pose in zip(views, poses, strict=True)
        ]
        typical_px = float(np.median([np.median(miss_px) for miss_px in misses]))
        verdicts = [_verdict(miss_px, typical_px) for miss_px in misses]
        kept = [i for i, verdict in enumerate(verdicts) if verdict.kept]
        if len(kept) < least_views:
            return [views[i] for i in kept], None, _dropped(views, verdicts)
        subset = [_part(views[i], verdicts[i].right) for i in kept]
        start = np.array([poses[i] for i in kept])
        if [list(v.right) for v in before] == [list(v.right) for v in verdicts]:
            break
        tolerance_px = max(_LINEAR_BEYOND * typical_px, _NEVER_BELOW_PX)
        solution = refine(subset, model, intrinsics, start, tolerance_px)
        intrinsics, before = solution.intrinsics, verdicts
        refined = dict(zip(kept, solution.poses, strict=True))
        poses = [
            _better_pose(view, model, intrinsics, refined.get(i)) for i, view in enumerate(views)
        ]
    return subset, refine(subset, model, intrinsics, start), _dropped(views, verdicts)


def _verdict(miss_px: Float, typical_px: float) -> _Verdict:
    view_limit_px = max(_VIEW_LIMIT * typical_px, _NEVER_BELOW_PX)
    point_limit_px = max(_POINT_LIMIT * typical_px, _NEVER_BELOW_PX)
    nothing = np.zeros(len(miss_px), bool)
    median_px = float(np.median(miss_px))
    if not np.isfinite(median_px):
        return _Verdict(nothing, "no place of the board explains its points")
    if median_px > view_limit_px:
        return _Verdict(
            nothing, f"its points are {median_px:.2g} px off, expected {view_limit_px:.2g}"
        )
    right = miss_px <= point_limit_px
    wrong = len(right) - int(right.sum())
    if len(right) - wrong < LEAST_POINTS or wrong > _MOST_POINTS_LOST * len(right):
        return _Verdict(
            nothing,
            f"{wrong} of its {len(right)} points are off by more than {point_limit_px:.2g} px",
        )
    return _Verdict(right, f"up to {miss_px.max():.2g} px off, expected {point_limit_px:.2g}")


def _better_pose(
    view: BoardView, model: str, intrinsics: Float, refined: Float | None
) -> Float | None:
    """The refined pose, or one found anew where that fits better: a flat board seen nearly from
    the front has two, and refining never leads from one to the other.
    """
    anew = pose_of(view, intrinsics, model)
    if refined is None or anew is None:
        return anew if refined is None else refined
    anew_px = float(np.median(misses_px(view, model, intrinsics, anew)))
    return anew if anew_px < np.median(misses_px(view, model, intrinsics, refined)) else refined


def _part(view: BoardView, right: NDArray[np.bool_]) -> BoardView:
    return BoardView(view.name, view.image_px[right], view.object_m[right])


def _dropped(views: Sequence[BoardView], verdicts: Sequence[_Verdict]) -> list[Dropped]:
    return [
        Dropped(
            view.name,
            tuple(int(i) for i in np.flatnonzero(~verdict.right)) if verdict.kept else (),
            verdict.reason,
        )
        for view, verdict in zip(views, verdicts, strict=True)
        if not verdict.right.all()
    ]
