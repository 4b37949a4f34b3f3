"""The scale of depth, the focal length and the heading against the motion of the machine.

Stems stand still. If depth is too large by a share, a stem seems to move with the machine: its
position in the map, p = c + H (1 + a) r, depends on the place c and heading H of the camera. The
errors are found by least squares from all views of all stems, each with its own unknown position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from basetree.arrays import Float
from basetree.counts import counted
from edgetree.live.tracking.plane import turns
from edgetree.measure import Estimate
from edgetree.rig_check.checks import RigCheck, judged
from edgetree.rig_check.peak_fit import resampled_stds
from edgetree.rig_check.stem_sightings import Sighting, level_axes

GROUP: Final = "scale against the machine's motion"

_MIN_STEMS: Final = 5
_MIN_VIEWS: Final = 3
_SCALE_LIMIT: Final = 3.0
_HEADING_LIMIT_DEG: Final = 2.0
# Beyond the stated deviations, per cent, per cent and degrees (benchmarks/check_rig.py).
_SYSTEMATIC: Final = (0.4, 0.4, 0.3)
# Added to the stated deviations of a stem's place ahead and to the side, m.
_FLOOR_M: Final = np.array([0.05, 0.03])
_HUBER, _ROUNDS = 1.5, 8


@dataclass(frozen=True, eq=False)
class _Views:
    """All views of one stem, N: the camera's place (N, 2), rotation to the map (N, 2, 2), and the
    stem ahead and to the left of the camera (N, 2) with its deviation (N, 2)."""

    place: Float
    turn: Float
    stem: Float
    std: Float


def odometry_checks(sightings: list[Sighting]) -> list[RigCheck]:
    """Check the scale of depth, the focal length and the heading.

    Args:
        sightings: Stems of all frames; those of frames without a pose are left out.
    """
    estimates = _estimates([each for each in sightings if each.frame.pose is not None])
    rows = (
        (
            "scale of the depth",
            _SCALE_LIMIT,
            "%",
            "calibrate the depth (edgetree calibrate --depth)",
        ),
        ("focal length", _SCALE_LIMIT, "%", "calibrate the camera (edgetree calibrate)"),
        ("heading to the left", _HEADING_LIMIT_DEG, "°", "measure how the camera is mounted"),
    )
    return [
        judged(
            name,
            GROUP,
            estimate,
            limit,
            unit,
            remedy=f"{remedy}; or the odometry is wrong",
            need="drive past more stems, with turns",
        )
        for (name, limit, unit, remedy), estimate in zip(rows, estimates, strict=True)
    ]


def _estimates(sightings: list[Sighting]) -> list[Estimate | str]:
    if not sightings:
        return ["needs the poses of the camera, which the source does not give"] * 3
    views = _views(sightings)
    if len(views) < _MIN_STEMS:
        text = f"{counted(len(views), 'stem')} with {_MIN_VIEWS} views: {_MIN_STEMS} are needed"
        return [f"{text}; drive past more stems"] * 3
    values, stds = _solve(views)
    units = (100.0, 100.0, math.degrees(1))
    return [
        Estimate(float(value) * unit, math.hypot(float(std) * unit, systematic))
        for value, std, unit, systematic in zip(values, stds, units, _SYSTEMATIC, strict=True)
    ]


def _views(sightings: list[Sighting]) -> list[_Views]:
    """The views of each stem that has enough of them."""
    poses = [each.frame.pose for each in sightings if each.frame.pose is not None]
    rotation = np.array([pose.rotation for pose in poses])
    place = np.array([pose.translation_m for pose in poses])[:, :2]
    point, _, covariance, _ = level_axes(sightings, rotation[:, 2])
    # The camera's optical axis on the level plane is the level frame's x axis.
    heading = np.arctan2(rotation[:, 1, 2], rotation[:, 0, 2])
    turn = turns(heading)
    std = np.sqrt(covariance[:, [0, 1], [0, 1]] + _FLOOR_M**2)
    stem = np.array([each.stem for each in sightings])
    all_views = (
        _Views(place[row], turn[row], point[row, :2], std[row])
        for row in (np.flatnonzero(stem == number) for number in np.unique(stem))
    )
    return [views for views in all_views if len(views.std) >= _MIN_VIEWS]


def _solve(views: list[_Views]) -> tuple[Float, Float]:
    """Robust weighted least squares (Huber's weights), and deviations from resampled stems.

    Each round takes the deviations of all views from their stems' mean places, as linear functions
    of the three errors, weighs them by their size, and solves the normal equations, which are sums
    over the stems. What remains of each stem's part of them at the solution is resampled.

    Returns:
        (3,) shares by which depth and focal length are too large, and the angle in rad by which
        the heading is too far left; (3,) their standard deviations, infinite if not determined.
    """
    robust = [np.ones(len(each.std)) for each in views]
    values = np.zeros(3)
    for _ in range(_ROUNDS):
        matrices, vectors = [], []
        for number, each in enumerate(views):
            error, rows = _linear(each, robust[number])
            off = (error - rows @ values) / each.std
            size = np.sqrt((off**2).mean(axis=1))
            robust[number] = _HUBER / np.maximum(size, _HUBER)
            weight = robust[number][:, None] / each.std**2
            matrices.append(np.einsum("nik,ni,nil->kl", rows, weight, rows))
            vectors.append(np.einsum("nik,ni,ni->k", rows, weight, error))
        matrix, vector = np.array(matrices), np.array(vectors)
        total = matrix.sum(axis=0)
        if np.linalg.cond(total) > 1e8:
            return values, np.full(3, np.inf)
        values = np.linalg.solve(total, vector.sum(axis=0))
    return values, resampled_stds(vector - matrix @ values, total)


def _linear(views: _Views, robust: Float) -> tuple[Float, Float]:
    """Deviations (N, 2) from the stem's mean place, and their derivatives (N, 2, 3).

    In the camera's level frame. The derivatives are taken at the mean place, whose error is
    smaller than that of a view: errors in them would make the result too small.
    """
    weight = robust / (views.std**2).sum(axis=1)
    weight = weight / weight.sum()
    place = views.place + np.einsum("nij,nj->ni", views.turn, views.stem)
    mean = weight @ place
    stem = np.einsum("nji,nj->ni", views.turn, mean - views.place)
    none = np.zeros(len(stem))
    # Depth scales both; the focal length divides what is to the side.
    rows = np.stack(
        [
            stem,
            np.column_stack([none, -stem[:, 1]]),
            np.column_stack([-stem[:, 1], stem[:, 0]]),
        ],
        axis=2,
    )
    in_map = np.einsum("nij,njk->nik", views.turn, rows)
    in_map = in_map - np.einsum("n,nik->ik", weight, in_map)
    back = views.turn.transpose(0, 2, 1)
    return np.einsum("nij,nj->ni", back, place - mean), back @ in_map
