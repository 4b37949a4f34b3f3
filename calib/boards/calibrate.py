"""Calibrate a camera from views of a board and judge the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from basetree.arrays import Float
from basetree.counts import counted
from calib.boards.coverage import Coverage, coverage_of
from calib.boards.result import Calibration, CalibrationFailure, Dropped, Parameter, ViewResult
from calib.boards.robust import solve_robustly
from calib.boards.shape import tell_shape
from calib.boards.solve import PARAMETERS, BoardView, Solution
from calib.boards.two_cameras import find_two_cameras, tell_left_out
from calib.camera import PinholeCamera
from calib.errors import CameraError

MIN_VIEWS: Final = 8
_MIN_TILT_DEG, _MIN_TILTED_VIEWS, _GOOD_TILT_DEG = 10.0, 3, 20.0
_MIN_COVERAGE_TO_SOLVE, _MIN_COVERAGE_TO_PASS = 0.25, 0.5
_MAX_RMS_PX = 0.8
_MAX_FOCAL_STD_SHARE, _MAX_DROPPED_SHARE = 0.005, 0.3
_MIN_DISTANCE_RATIO = 1.3
_TAKE_MORE = "take 15 to 30 images of the whole board, near and far, tilted in all directions"


def calibrate_camera(
    views: Sequence[BoardView], size: tuple[int, int], model: str = "radtan"
) -> Calibration | CalibrationFailure:
    """Estimate intrinsics and distortion from views of a board.

    Views and points that do not agree with the others are left out and named.

    Args:
        views: Points of the board in each image, from `find_boards`.
        size: Width and height of the images in px.
        model: "radtan" (k1, k2, p1, p2, k3) or "fisheye" (k1 to k4), as OpenCV defines them.

    Returns:
        A Calibration, or a falsy CalibrationFailure if fewer than 8 views agree, if the board had
        nearly the same orientation in all of them (then focal length and distance cannot be
        separated), or if its points cover less than a quarter of the image.

    Raises:
        CameraError: If `model` is unknown.
    """
    if model not in PARAMETERS:
        raise CameraError(f"model is {model!r}: expected one of {', '.join(PARAMETERS)}")
    if len(views) < MIN_VIEWS:
        return _too_few(len(views), ())
    coverage = coverage_of([view.image_px for view in views], size)
    if coverage.share < _MIN_COVERAGE_TO_SOLVE:
        return CalibrationFailure(
            f"the points cover {coverage.share:.0%} of the image, expected at least"
            f" {_MIN_COVERAGE_TO_SOLVE:.0%}: the distortion elsewhere is unknown",
            tuple(coverage.advice()),
        )
    kept, solution, dropped = solve_robustly(views, size, model, MIN_VIEWS)
    whole = [each.view for each in dropped if not each.points]
    told = tell_left_out([view.name for view in views], whole)
    if solution is None:
        return _too_few(len(kept), tuple(dropped), told)
    reason = _undetermined(solution)
    if reason is not None:
        advice = ("tilt the board by 20 to 45 degrees in all directions",)
        return CalibrationFailure(reason, advice, tuple(dropped))
    result = _result(kept, solution, dropped, size, model)
    return replace(result, advice=(told, *result.advice)) if told else result


def _too_few(
    count: int, dropped: tuple[Dropped, ...], told: str | None = None
) -> CalibrationFailure:
    agreeing = " that agree with each other" if dropped else ""
    return CalibrationFailure(
        f"{counted(count, 'view')} of the board{agreeing}, expected at least {MIN_VIEWS}",
        (*([told] if told else []), _TAKE_MORE),
        dropped,
    )


def _tilts_deg(poses: Float) -> Float:
    """Return the (V,) angles between each board and the mean orientation."""
    normals = np.array([cv2.Rodrigues(pose[:3])[0][:, 2] for pose in poses])
    normals = normals * np.where(normals[:, 2:] < 0, -1.0, 1.0)  # away from the camera
    mean = normals.mean(0) / np.linalg.norm(normals.mean(0))
    return np.asarray(np.degrees(np.arccos(np.clip(normals @ mean, -1, 1))))


def _undetermined(solution: Solution) -> str | None:
    """Return why these views do not determine the camera, or None if they do."""
    tilt_deg = float(np.sort(_tilts_deg(solution.poses))[-_MIN_TILTED_VIEWS])
    if tilt_deg < _MIN_TILT_DEG:
        return (
            "the board had nearly the same orientation in all views (within"
            f" {tilt_deg:.0f} degrees, expected {_MIN_TILTED_VIEWS} views or more tilted by"
            f" {_MIN_TILT_DEG:.0f}):"
            " focal length and distance cannot be separated"
        )
    if solution.stds is None:
        return "the views do not determine the camera: they are too similar"
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
    both_px = (float(max(stds[:2])), float(max(stds[2:4])))
    try:
        camera = PinholeCamera(*size, fx, fy, cx, cy, tuple(terms), model, *both_px)
    except CameraError as error:
        return CalibrationFailure(
            f"the solution is not a valid camera: {error}", (), tuple(dropped)
        )
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
    apart, told = find_two_cameras(views, model, solution)
    reasons = _reasons_to_fail(camera, rms_px, coverage, len(results), dropped)
    assert solution.shape_covariance is not None
    shape = tell_shape(solution.frame, solution.shape, solution.shape_covariance)
    advice = [*shape, *_advice(results, coverage, _tilts_deg(solution.poses))]
    return Calibration(
        camera,
        parameters,
        rms_px,
        results,
        tuple(dropped),
        coverage,
        tuple([apart, *reasons] if apart else reasons),
        tuple([told, *advice] if told else advice),
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
    """Return the root mean square of the residual vectors' lengths."""
    return float(np.sqrt((residuals_px**2).sum(1).mean()))


def _reasons_to_fail(
    camera: PinholeCamera,
    rms_px: float,
    coverage: Coverage,
    views: int,
    dropped: Sequence[Dropped],
) -> list[str]:
    """Return why the calibration is not good enough to measure with."""
    reasons = []
    whole = sum(not each.points for each in dropped)
    if whole > _MAX_DROPPED_SHARE * (views + whole):
        reasons.append(f"{whole} of {views + whole} views do not agree with the others")
    if rms_px > _MAX_RMS_PX:
        reasons.append(
            f"the RMS reprojection error is {rms_px:.2f} px, expected {_MAX_RMS_PX} or less"
        )
    focal_share = camera.focal_std_px / min(camera.fx, camera.fy)
    if focal_share > _MAX_FOCAL_STD_SHARE:
        reasons.append(
            f"the focal length has a standard deviation of {focal_share:.2%},"
            f" expected {_MAX_FOCAL_STD_SHARE:.2%} or less"
        )
    if coverage.share < _MIN_COVERAGE_TO_PASS:
        reasons.append(
            f"the points cover {coverage.share:.0%} of the image, expected at least"
            f" {_MIN_COVERAGE_TO_PASS:.0%}"
        )
    return reasons


def _advice(views: Sequence[ViewResult], coverage: Coverage, tilts_deg: Float) -> list[str]:
    """Return what further views would help."""
    lines = coverage.advice()
    well_tilted = int((tilts_deg >= _GOOD_TILT_DEG).sum())
    if 3 * well_tilted < len(views):
        lines.append(
            f"{well_tilted} of {len(views)} views are tilted by {_GOOD_TILT_DEG:.0f} degrees or"
            " more: tilt the board further, in all directions"
        )
    distances_m = [view.distance_m for view in views]
    if max(distances_m) < _MIN_DISTANCE_RATIO * min(distances_m):
        lines.append(
            f"the board was always {min(distances_m):.2f} to {max(distances_m):.2f} m away:"
            " also hold it nearer and farther"
        )
    return lines
