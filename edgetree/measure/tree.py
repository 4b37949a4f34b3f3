"""One tree in metres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera, pixels_to_rays
from edgetree.detections import KEYPOINT_NAMES
from edgetree.measure.axis import fit_axis
from edgetree.measure.estimates import Estimate, Failure, TreeMeasurement
from edgetree.measure.frame import DepthFrame
from edgetree.measure.ground import GROUND_REACHES_M, BaseGround, fit_base_ground
from edgetree.measure.section import AxisFrame
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.stem import Stem, fit_stem

__all__ = ["measure_tree"]

Float = NDArray[np.floating[Any]]

_CUT, _LEFT, _RIGHT, _MIDDLE, _TOP = range(len(KEYPOINT_NAMES))
_CAMERA_UP = np.array([0.0, -1.0, 0.0])
# Without a given vertical the camera's own up stands in, mounted or held this crookedly.
_CAMERA_UP_STD_DEG = 15.0
_GROUND_TILT_STD_RAD = 0.03
_LEAST_WIDTH_PX = 1.0
_LEAST_DIAMETER_M = 0.02
_MOST_RELATIVE_STD = 0.5
# The cut lies a little below the diameter's section, and not in the ground.
_CUT_ABOVE_SECTION_M = (-0.5, 0.3)
_MOST_CUT_IN_GROUND_M = 0.1


def measure_tree(
    frame: DepthFrame, index: int, box_px: Float, keypoints: Float, up: Float | None
) -> TreeMeasurement:
    """Measure tree `index` of a frame.

    Args:
        frame: depth, camera, masks and settings.
        index: the tree's place among the masks.
        box_px: (4,) its box.
        keypoints: (5, 3) float64 x px, y px, score.
        up: (3,) unit vector of the vertical; None takes the ground's normal.
    """
    settings = frame.settings
    given = _given(keypoints, frame.camera)
    std_px = _keypoint_std_px(box_px, keypoints, settings)
    given[_CUT] &= _within(keypoints[_CUT], std_px[_CUT], frame.camera)
    if not (given[_LEFT] and given[_RIGHT]):
        return TreeMeasurement.failed("the diameter keypoints are not in the image")
    width_px = float(np.linalg.norm(keypoints[_RIGHT, :2] - keypoints[_LEFT, :2]))
    if width_px < _LEAST_WIDTH_PX:
        return TreeMeasurement.failed(f"the diameter keypoints are {width_px:.1f} px apart")
    rays = pixels_to_rays(frame.camera, np.where(given[:, None], keypoints[:, :2], 0.0))
    edges = (rays[_LEFT], rays[_RIGHT])
    pixel_rad = _pixel_rad(frame.camera, sum(edges) / 2)
    axis, roll_std_rad = _axis(rays, given, std_px[:, 0] * pixel_rad, up, settings)
    lean_std_rad = _lean_std_rad(up, settings)
    readings = frame.stem_readings(index, box_px)
    if isinstance(readings, Failure):
        return TreeMeasurement.failed(readings.reason)
    stem = fit_stem(readings, edges, axis, lean_std_rad, settings)
    if isinstance(stem, Failure):
        return TreeMeasurement.failed(stem.reason)
    if not _LEAST_DIAMETER_M <= 2 * stem.radius_m <= settings.max_diameter_m:
        return TreeMeasurement.failed(f"a diameter of {2 * stem.radius_m:.2f} m is not plausible")
    edges_px = float(np.hypot(std_px[_LEFT, 0], std_px[_RIGHT, 0])) / np.sqrt(2)
    edge_rad = edges_px * _edge_pixel_rad(frame.camera, stem)
    diameter_std_m = _diameter_std_m(stem, edge_rad, settings)
    diameter = _diameter(stem, diameter_std_m)
    cut_ray = rays[_CUT] if given[_CUT] else None
    # Where the cut is not in the image, the ground is still looked for, below the section.
    cut = stem.axis_point(edges[0] if cut_ray is None else cut_ray)
    ground = _ground(frame, cut, stem.radius_m, up)
    inclination = _inclination(stem, roll_std_rad, up, ground, settings)
    if cut_ray is None:
        missing = Failure("the felling cut is not in the image")
        return TreeMeasurement(diameter, missing, inclination, missing, missing)
    cut_rad = float(std_px[_CUT, 1]) * pixel_rad
    distance = _distance(stem, cut, cut_rad, diameter_std_m)
    height = _cut_height(stem, cut, ground, distance, cut_rad)
    misplaced = _misplaced(stem, cut, edges, height)
    if misplaced is not None:
        return TreeMeasurement(diameter, misplaced, inclination, misplaced, misplaced)
    return TreeMeasurement(diameter, height, inclination, distance, stem.front_point(cut_ray))


def _given(keypoints: Float, camera: PinholeCamera) -> NDArray[np.bool_]:
    """(5,) which keypoints say something: scored, and at most an image's size outside it."""
    size = np.array([camera.width, camera.height])
    with np.errstate(invalid="ignore"):
        near = (np.abs(keypoints[:, :2] - size / 2) <= 1.5 * size).all(1)
    return np.asarray(np.isfinite(keypoints).all(1) & (keypoints[:, 2] > 0) & near)


def _keypoint_std_px(box_px: Float, keypoints: Float, settings: MeasureSettings) -> Float:
    """(5, 2) errors across and along the stem: the flatter a heat map over the box, the larger.

    Across, edges hold the heat map within the box's width; along, nothing does.
    """
    width, height = np.maximum(box_px[2:] - box_px[:2], 0.0)
    extent = np.array([width, np.sqrt(width * height)])
    score = np.clip(np.nan_to_num(keypoints[:, 2:]), 1e-4, 1.0)
    spread = settings.keypoint_spread * extent / np.sqrt(score)
    return np.asarray(np.hypot(settings.keypoint_std_px, spread))


def _within(keypoint: Float, std_px: Float, camera: PinholeCamera) -> bool:
    """Whether a keypoint lies inside the image for certain: at its border it may be beyond."""
    size = np.array([camera.width, camera.height])
    return bool((keypoint[:2] > std_px).all() and (keypoint[:2] < size - std_px).all())


def _misplaced(
    stem: Stem, cut: Float, edges: tuple[Float, Float], height: Estimate | Failure
) -> Failure | None:
    """Why the keypoint of the felling cut cannot be where the tree is cut, if so."""
    above_m = float((cut - stem.axis_point(edges[0] + edges[1])) @ stem.section.frame.along)
    lowest_m, highest_m = _CUT_ABOVE_SECTION_M
    if not lowest_m <= above_m <= highest_m:
        side = "above" if above_m > 0 else "below"
        return Failure(f"the felling cut is {abs(above_m):.2f} m {side} the diameter's section")
    if isinstance(height, Estimate) and height.value < -_MOST_CUT_IN_GROUND_M - 2 * height.std:
        return Failure(f"the felling cut is {-height.value:.2f} m below the ground")
    return None


def _pixel_rad(camera: PinholeCamera, ray: Float) -> float:
    """The angle of one pixel around a ray (3,)."""
    return float(1 / (camera.fx * np.linalg.norm(ray)))


def _edge_pixel_rad(camera: PinholeCamera, stem: Stem) -> float:
    """How far one pixel turns an edge of the stem around the camera, across the axis."""
    section = stem.section
    ray = section.centre / section.centre[2]
    across = section.frame.across
    reach = float(np.hypot(ray @ across, ray @ section.frame.away))
    return float(np.hypot(across[0] / camera.fx, across[1] / camera.fy)) / reach


def _lean_std_rad(up: Float | None, settings: MeasureSettings) -> float:
    """How far a stem may stand off the vertical that is known."""
    crooked_deg = _CAMERA_UP_STD_DEG if up is None else 0.0
    return float(np.radians(np.hypot(settings.lean_std_deg, crooked_deg)))


def _axis(
    rays: Float,
    given: NDArray[np.bool_],
    keypoint_rad: Float,
    up: Float | None,
    settings: MeasureSettings,
) -> tuple[AxisFrame, float]:
    """The axis in the picture, from the section's middle and the axis keypoints there are."""
    section = rays[[_LEFT, _RIGHT]]
    middle = (section / np.linalg.norm(section, axis=1, keepdims=True)).sum(0)
    points, stds = [middle], [float(np.hypot(*keypoint_rad[[_LEFT, _RIGHT]])) / 2]
    for index in (_MIDDLE, _TOP):
        if given[index]:
            points.append(rays[index])
            stds.append(float(keypoint_rad[index]))
    vertical = _CAMERA_UP if up is None else up
    return fit_axis(np.array(points), np.array(stds), vertical, _lean_std_rad(up, settings))


def _ground(
    frame: DepthFrame, cut: Float, radius_m: float, up: Float | None
) -> BaseGround | Failure:
    """The ground next to the stem, or where that does not show, further around it."""
    ground: BaseGround | Failure = Failure("")
    for reach_m in GROUND_REACHES_M:
        points = frame.ground_points(cut, reach_m + radius_m)
        ground = fit_base_ground(points, cut, reach_m + radius_m, up, frame.settings)
        if ground:
            break
    return ground


def _diameter_std_m(stem: Stem, edge_rad: float, settings: MeasureSettings) -> float:
    """From distance, edges and shape; the edges' angles count with half the width's cotangent."""
    shares = (
        stem.distance_std_m / stem.distance_m,
        edge_rad / np.sqrt(2) / np.tan(stem.section.half_angle_rad),
        settings.out_of_round_std,
    )
    return 2 * stem.radius_m * float(np.linalg.norm(shares))


def _diameter(stem: Stem, std_m: float) -> Estimate | Failure:
    value = 2 * stem.radius_m
    if std_m > _MOST_RELATIVE_STD * value:
        return Failure(f"the diameter is too uncertain: {value:.2f} m ± {std_m:.2f} m")
    return Estimate(value, std_m)


def _distance(stem: Stem, cut: Float, cut_rad: float, diameter_std_m: float) -> Estimate:
    """To the axis at the cut: what the depth gives is the bark, one radius before it."""
    value = float(np.linalg.norm(cut))
    along_m = float(cut @ stem.section.frame.along)
    from_depth = stem.distance_std_m * value / stem.distance_m
    parts = (from_depth, diameter_std_m / 2, along_m * cut_rad)
    return Estimate(value, float(np.linalg.norm(parts)))


def _cut_height(
    stem: Stem, cut: Float, ground: BaseGround | Failure, distance: Estimate, cut_rad: float
) -> Estimate | Failure:
    """Above the ground; errs with the distance where looked at from above, and with the cut."""
    if isinstance(ground, Failure):
        return ground
    frame = stem.section.frame
    rise = float(cut @ ground.up) / distance.value
    cut_std_m = float(np.hypot(rise * distance.std, cut_rad * distance.value))
    return ground.cut_height_m(cut, frame.along, stem.radius_m, cut_std_m)


def _inclination(
    stem: Stem,
    roll_std_rad: float,
    up: Float | None,
    ground: BaseGround | Failure,
    settings: MeasureSettings,
) -> Estimate | Failure:
    """The axis against the vertical; its error along the direction of the lean."""
    if up is None and isinstance(ground, Failure):
        return Failure(f"no vertical: {ground.reason}")
    vertical = up if isinstance(ground, Failure) else ground.up
    assert vertical is not None
    frame = stem.section.frame
    roll, tilt = float(vertical @ frame.across), float(vertical @ frame.away)
    value = float(np.degrees(np.arccos(np.clip(vertical @ frame.along, -1.0, 1.0))))
    total = roll**2 + tilt**2
    share = roll**2 / total if total > 0 else 0.5
    variance = share * roll_std_rad**2 + (1 - share) * stem.tilt_std_rad**2
    variance += 0.0 if up is not None else _GROUND_TILT_STD_RAD**2
    std_deg = float(np.hypot(np.degrees(np.sqrt(variance)), settings.bend_std_deg))
    return Estimate(value, std_deg)
