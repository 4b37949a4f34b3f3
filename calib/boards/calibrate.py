"""A camera from views of a board, with a judgement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.boards.coverage import Coverage, coverage_of
from calib.boards.result import Calibration, CalibrationFailure, Dropped, Parameter, ViewResult
from calib.boards.robust import solve_robustly
from calib.boards.solve import PARAMETERS, BoardView, Solution
from calib.camera import PinholeCamera
from calib.errors import CameraError

Float = NDArray[np.floating[Any]]

LEAST_VIEWS: Final = 8
_LEAST_TURN_DEG, _TURNED_VIEWS, _WELL_TURNED_DEG = 10.0, 3, 20.0
_NARROW_COVERAGE, _LEAST_COVERAGE = 0.25, 0.5
_MOST_RMS_PX = 0.8
_MOST_FOCAL_SHARE, _MOST_DROPPED = 0.005, 0.3
_NARROW_DISTANCES = 1.3


def calibrate_camera(
    views: Sequence[BoardView], size: tuple[int, int], model: str = "radtan"
) -> Calibration | CalibrationFailure:
    """The camera of ``size`` (width, height) px that explains all views best.

    ``model`` is "radtan" (k1, k2, p1, p2, k3) or "fisheye" (k1 to k4), as OpenCV defines them.
    Views and points that do not agree with the others are left out and named. A failure where
    there are fewer than 8 views, where the board stood at one angle in all of them (focal length
    and distance cannot be told apart), or where its points leave most of the picture empty.
    Raises CameraError for another model.
    """
    if model not in PARAMETERS:
        raise CameraError(f"model is {model!r}: expected one of {', '.join(PARAMETERS)}")
    if len(views) < LEAST_VIEWS:
        return _too_few(len(views), ())
    coverage = coverage_of([view.image_px for view in views], size)
    if coverage.share < _NARROW_COVERAGE:
        return CalibrationFailure(
            f"the points lie in {coverage.share:.0%} of the picture, expected at least"
            f" {_NARROW_COVERAGE:.0%}: what the lens does elsewhere cannot be told",
            tuple(coverage.advice()),
        )
    kept, solution, dropped = solve_robustly(views, size, model, LEAST_VIEWS)
    if solution is None:
        return _too_few(len(kept), tuple(dropped))
    reason = _undetermined(solution)
    if reason is not None:
        advice = ("tilt the board by 20 to 45 degrees, to all sides",)
        return CalibrationFailure(reason, advice, tuple(dropped))
    return _result(kept, solution, dropped, size, model)


def _too_few(count: int, dropped: tuple[Dropped, ...]) -> CalibrationFailure:
    agreeing = " that agree with each other" if dropped else ""
    return CalibrationFailure(
        f"{count} views of the board{agreeing}, expected at least {LEAST_VIEWS}",
        ("take 15 to 30 pictures of the whole board, near and far, tilted to all sides",),
        dropped,
    )


def _normals(poses: Float) -> Float:
    """(V, 3) unit vectors across the boards, away from the camera."""
    normals = np.array([cv2.Rodrigues(pose[:3])[0][:, 2] for pose in poses])
    return np.asarray(normals * np.where(normals[:, 2:] < 0, -1.0, 1.0))


def _turns_deg(poses: Float) -> Float:
    """(V,) angles between each board and their mean orientation."""
    normals = _normals(poses)
    mean = normals.mean(0) / np.linalg.norm(normals.mean(0))
    return np.asarray(np.degrees(np.arccos(np.clip(normals @ mean, -1, 1))))


def _undetermined(solution: Solution) -> str | None:
    """Why these views cannot tell the camera, if they cannot."""
    turn_deg = float(np.sort(_turns_deg(solution.poses))[-_TURNED_VIEWS])
    if turn_deg < _LEAST_TURN_DEG:
        return (
            f"the board stood at nearly one angle in all views (within {turn_deg:.0f} degrees,"
            f" expected {_TURNED_VIEWS} views or more turned by {_LEAST_TURN_DEG:.0f}):"
            " focal length and distance cannot be told apart"
        )
    if solution.stds is None:
        return "the views do not determine the camera: they are too much alike"
    return None


def _result(
    views: Sequence[BoardView],
    solution: Solution,
    dropped: Sequence[Dropped],
    size: tuple[int, int],
    model: str,
) -> Calibration | CalibrationFailure:
    stds = solution.stds
    assert stds is not None
    values = [float(value) for value in solution.intrinsics]
    fx, fy, cx, cy, *terms = values
    focal_std_px = float(max(stds[:2]))
    try:
        camera = PinholeCamera(*size, fx, fy, cx, cy, tuple(terms), model, focal_std_px)
    except CameraError as error:
        return CalibrationFailure(f"the views fit no real camera: {error}", (), tuple(dropped))
    parameters = tuple(
        Parameter(name, value, float(std), "px" if i < 4 else "")
        for i, (name, value, std) in enumerate(zip(PARAMETERS[model], values, stds, strict=True))
    )
    results = tuple(
        _view_result(*each)
        for each in zip(views, solution.residuals_px, solution.poses, strict=True)
    )
    rms_px = _rms_px(np.concatenate(solution.residuals_px))
    coverage = coverage_of([view.image_px for view in views], size)
    return Calibration(
        camera,
        parameters,
        rms_px,
        results,
        tuple(dropped),
        coverage,
        tuple(_shortcomings(camera, rms_px, coverage, len(results), dropped)),
        tuple(_advice(results, coverage, _turns_deg(solution.poses))),
    )


def _view_result(view: BoardView, residuals_px: Float, pose: Float) -> ViewResult:
    rotation = cv2.Rodrigues(pose[:3])[0]
    middle_m = rotation @ view.object_m.mean(0) + pose[3:]
    return ViewResult(
        view.name,
        len(view.image_px),
        _rms_px(residuals_px),
        float(np.linalg.norm(residuals_px, axis=1).max()),
        float(middle_m[2]),
        float(np.degrees(np.arccos(min(1.0, abs(rotation[2, 2]))))),
        tuple(float(value) for value in pose),
    )


def _rms_px(residuals_px: Float) -> float:
    """Of the distances, not of their two components."""
    return float(np.sqrt((residuals_px**2).sum(1).mean()))


def _shortcomings(
    camera: PinholeCamera,
    rms_px: float,
    coverage: Coverage,
    views: int,
    dropped: Sequence[Dropped],
) -> list[str]:
    """Why this calibration is not good enough to measure with."""
    reasons = []
    whole = sum(not each.points for each in dropped)
    if whole > _MOST_DROPPED * (views + whole):
        reasons.append(f"{whole} of {views + whole} views do not agree with the others")
    if rms_px > _MOST_RMS_PX:
        reasons.append(f"the points are {rms_px:.2f} px off (RMS), expected {_MOST_RMS_PX} or less")
    focal_share = camera.focal_std_px / min(camera.fx, camera.fy)
    if focal_share > _MOST_FOCAL_SHARE:
        reasons.append(
            f"the focal length is known to {focal_share:.1%}, expected {_MOST_FOCAL_SHARE:.1%}"
        )
    if coverage.share < _LEAST_COVERAGE:
        reasons.append(
            f"the points reach {coverage.share:.0%} of the picture, expected {_LEAST_COVERAGE:.0%}"
        )
    return reasons


def _advice(views: Sequence[ViewResult], coverage: Coverage, turns_deg: Float) -> list[str]:
    """What further views would help."""
    lines = coverage.advice()
    well_turned = int((turns_deg >= _WELL_TURNED_DEG).sum())
    if 3 * well_turned < len(views):
        lines.append(
            f"{well_turned} of {len(views)} views are turned by {_WELL_TURNED_DEG:.0f} degrees or"
            " more: tilt the board further, to all sides"
        )
    distances_m = [view.distance_m for view in views]
    if max(distances_m) < _NARROW_DISTANCES * min(distances_m):
        lines.append(
            f"the board was always {min(distances_m):.2f} to {max(distances_m):.2f} m away:"
            " hold it nearer and farther too"
        )
    return lines
