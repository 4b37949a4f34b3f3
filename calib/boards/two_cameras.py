"""Notice views of two cameras that were calibrated as one.

The views are split in two by their names and by their order. For each split, a score test asks
whether each half has a focal length and centre of its own (Rao, 1948). The difference between the
halves is compared with the noise of the points, and with how much the views of one half differ
among each other (Hotelling, 1931), because a bent board gives all points of a view correlated
errors. The smaller of the two counts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from calib.boards.solve import BoardView, Solution, project, shape_derivatives

_MIN_VIEWS = 4  # of each half
# Of a standard normal, as which the ratio of variances is read. Names such as left and right are a
# reason to expect two cameras, so that a chance of 1 of 100 is told; of other names 1 of 10,000;
# less for the many splits by order.
_MOST_STDS_OF_EYES, _MOST_STDS_BY_NAME, _MOST_STDS_BY_ORDER = 2.33, 3.72, 5.0
_TESTED = 3  # focal length and centre; then what all views share
_EYE = re.compile(r"left|right|l|r|(cam|camera|infra|eye|lens|sensor)([0-9]{1,2}|[a-z])")


class Split(NamedTuple):
    """Two halves of the views.

    Attributes:
        first: (V,) whether each view is in the first half.
        words: Which pictures are meant, for messages.
        most_stds: The largest difference that chance makes.
        names_cameras: Whether the names of the halves look like those of two cameras.
    """

    first: Bool
    words: str
    most_stds: float
    names_cameras: bool = False


class _Score(NamedTuple):
    """What a view alone says about the intrinsics.

    Attributes:
        gradient: (P,) of half the squared residuals, with the sign of a step that lowers them, for
            steps of both focal lengths, cx, cy, fx alone, the terms of the lens and of the
            board's shape.
        information: (P, P) Gauss-Newton matrix of them.
    """

    gradient: Float
    information: Float


def find_two_cameras(
    views: Sequence[BoardView], model: str, solution: Solution
) -> tuple[str | None, str | None]:
    """Tell whether the views are of two cameras.

    Args:
        views: The views used.
        model: "radtan" or "fisheye".
        solution: The camera that fits them together.

    Returns:
        Why they are not of one camera, or None; and a line if their names speak of two cameras
        although they fit one, or None.
    """
    splits = list(_splits([view.name for view in views]))
    scores = [
        _score(view, model, solution, pose)
        for view, pose in zip(views, solution.poses, strict=True)
    ]
    residuals = np.concatenate(solution.residuals_px)
    freedom = max(1, residuals.size - 6 * len(views) - len(solution.intrinsics))
    variance_px2 = float(np.sum(residuals**2)) / freedom
    found = [
        (_difference_stds(scores, split.first, variance_px2) - split.most_stds, split)
        for split in splits
    ]
    beyond, split = max(found, key=lambda each: each[0], default=(0.0, None))
    if split is not None and beyond > 0:
        one, other = (
            float(solution.intrinsics[1] + _step(_sum(scores, half))[0])
            for half in (split.first, ~split.first)
        )
        return (
            f"the pictures {split.words} do not fit one camera (focal lengths of {one:.5g} and"
            f" {other:.5g} px): expected pictures of one camera with one focus; calibrate them"
            " apart"
        ), None
    told = next((split.words for split in splits if split.names_cameras), None)
    if told is None:
        return None, None
    return None, f"the pictures {told} are taken for one camera, which they fit"


def tell_left_out(names: Sequence[str], left_out: Sequence[str]) -> str | None:
    """Return a line if the views left out are all those with one name, as of another camera."""
    missing = np.isin(names, left_out)
    for one, other, first in _groups_of_names(names):
        for name, half in ((one, first), (other, ~first)):
            if half.sum() >= _MIN_VIEWS and not (missing & ~half).any() and missing[half].all():
                return f"all pictures with {name!r} in their names are left out: another camera?"
    return None


def _groups_of_names(names: Sequence[str]) -> Iterator[tuple[str, str, Bool]]:
    """Yield the parts of names that have exactly two values, as in left-01 and right-01.

    Args:
        names: N names.

    Yields:
        Both values, and (N,) whether each name has the first.
    """
    parts = [re.findall(r"[0-9]+|[^\W\d_]+", name.lower()) for name in names]
    wholes = [re.split(r"[\W_]+", name.lower()) for name in names]
    seen = set()
    for rows in (wholes, parts):
        for column in range(min(map(len, rows), default=0)):
            values = [row[column] for row in rows]
            kinds = sorted(set(values))
            if len(kinds) == 2 and tuple(values) not in seen:
                seen.add(tuple(values))
                yield kinds[0], kinds[1], np.array([value == kinds[0] for value in values])


def _splits(names: Sequence[str]) -> Iterator[Split]:
    count = len(names)
    for one, other, first in _groups_of_names(names):
        if min(first.sum(), (~first).sum()) >= _MIN_VIEWS:
            eyes = bool(_EYE.fullmatch(one) and _EYE.fullmatch(other))
            words = f"with {one!r} and with {other!r} in their names"
            yield Split(first, words, _MOST_STDS_OF_EYES if eyes else _MOST_STDS_BY_NAME, eyes)
    order = np.arange(count)
    for until in range(_MIN_VIEWS, count - _MIN_VIEWS + 1):
        words = f"up to {names[until - 1]} and from {names[until]} on"
        yield Split(order < until, words, _MOST_STDS_BY_ORDER)
    if count >= 2 * _MIN_VIEWS:
        yield Split(order % 2 == 0, "at odd and at even places", _MOST_STDS_BY_ORDER)


def _score(view: BoardView, model: str, solution: Solution, pose: Float) -> _Score:
    xy_px, by_camera, by_pose = project(model, solution.intrinsics, pose, view.object_m)
    by_shape = shape_derivatives(by_pose, pose, solution.frame.basis_m(view.object_m))
    residual = (view.image_px - 0.5 - xy_px).ravel()
    basis, _ = np.linalg.qr(by_pose)
    by_focal = by_camera[:, :2].sum(1), by_camera[:, 2], by_camera[:, 3], by_camera[:, 0]
    by_camera = np.column_stack([*by_focal, by_camera[:, 4:], by_shape])
    alone = by_camera - basis @ (basis.T @ by_camera)
    return _Score(alone.T @ residual, alone.T @ alone)


def _difference_stds(scores: Sequence[_Score], first: Bool, variance_px2: float) -> float:
    """Return how far the halves differ, as the value of a standard normal."""
    halves = [_sum(scores, half) for half in (first, ~first)]
    apart = _without_lens(_sum(scores, np.ones(len(scores), bool)).information)
    found = apart @ halves[0].gradient
    one, other = (apart @ half.information @ apart.T for half in halves)
    share = one @ np.linalg.pinv(one + other, hermitian=True)
    expected = share @ other * variance_px2
    scatter = np.zeros_like(expected)
    for half, whole, weight in zip(
        (first, ~first), halves, (np.eye(_TESTED) - share, share), strict=True
    ):
        step, count = _step(whole), int(half.sum())
        for score in (score for score, is_in in zip(scores, half, strict=True) if is_in):
            rest = weight @ apart @ (score.gradient - score.information @ step)
            scatter += np.outer(rest, rest) * count / (count - 1)
    by_points = float(found @ np.linalg.pinv(expected) @ found) / _TESTED
    by_views = float(found @ np.linalg.pinv(scatter, hermitian=True) @ found) / _TESTED
    freedom = len(scores) - 2 - _TESTED + 1
    by_views *= freedom / (len(scores) - 2)
    return min(_as_normal(by_points, np.inf), _as_normal(by_views, freedom))


def _without_lens(information: Float) -> Float:
    """Return the (3, P) matrix that gives the scores of focal length and centre alone."""
    scale = _scale(information)
    unit = information / np.outer(scale, scale)
    mixed = unit[:_TESTED, _TESTED:] @ np.linalg.pinv(unit[_TESTED:, _TESTED:], hermitian=True)
    return np.hstack([np.eye(_TESTED), -mixed]) * (scale[:_TESTED, None] / scale)


def _as_normal(ratio: float, freedom: float) -> float:
    """Return the standard normal value as rare as a ratio of variances (Paulson, 1942)."""
    low, high = 2 / (9 * _TESTED), 2 / (9 * freedom)
    root = np.cbrt(ratio)
    return float((root * (1 - high) - (1 - low)) / np.sqrt(low + root**2 * high))


def _sum(scores: Sequence[_Score], half: Bool) -> _Score:
    """Return what the views of one half say together."""
    chosen = [score for score, is_in in zip(scores, half, strict=True) if is_in]
    return _Score(*(np.sum(values, axis=0) for values in zip(*chosen, strict=True)))


def _step(score: _Score) -> Float:
    """Return the (P,) step from the joint intrinsics to those of these views alone."""
    scale = _scale(score.information)
    unit = score.information / np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(unit, hermitian=True) @ (score.gradient / scale) / scale)


def _scale(information: Float) -> Float:
    """Return the (P,) roots of the diagonal, which bring pixels and terms to one scale."""
    return np.asarray(np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny)))
