"""Measure the trees of one image: the steps, in their order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Bool, Float, Float32
from calib import PinholeCamera, RigidTransform
from calib.directions import CAMERA_UP
from edgetree.detections import TreeDetections
from edgetree.measure.base_ground import BaseGround, UnseenGround
from edgetree.measure.constants.ground import CAMERA_UP_STD_DEG
from edgetree.measure.estimates import Failure, TreeMeasurement
from edgetree.measure.fitted_frame import FittedFrame
from edgetree.measure.frame import DepthFrame
from edgetree.measure.ground import find_grounds
from edgetree.measure.ground_cover import noise_factor
from edgetree.measure.inputs import checked_frame, vertical_of
from edgetree.measure.keypoints import Keypoints
from edgetree.measure.observations import StemObservations, observe_stems
from edgetree.measure.regions import STATIONS
from edgetree.measure.rig_uncertainty import RigUncertainty
from edgetree.measure.second_stem import without_second_stems
from edgetree.measure.section import StemAxes, fit_axes
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.stem_fit import fit_stems
from edgetree.measure.straight_part import with_straight_parts
from edgetree.measure.vertical import Verticals
from edgetree.measure.views import View, stem_views


def measure_trees(
    detections: TreeDetections,
    depth_m: Float32,
    camera: PinholeCamera,
    *,
    masks: Sequence[Bool] | Bool | None = None,
    up_camera: ArrayLike | None = None,
    mounting: RigidTransform | None = None,
    settings: MeasureSettings | None = None,
    rig_uncertainty: RigUncertainty | None = None,
    sparse: bool = False,
) -> list[TreeMeasurement]:
    """Measure every tree of one image.

    Args:
        detections: The N trees, in pixels of this image, with keypoints, masks or both.
            Keypoints with score 0 are not used.
        depth_m: (H, W) depth z along the optical axis in metres, of a float dtype; 0, NaN or
            infinite where there is no reading.
        camera: Intrinsics of the depth map, for this image size.
        masks: (N, H, W) bool masks that replace those of the detections, for example drawn by
            hand or from another segmentation.
        up_camera: (3,) direction away from gravity in camera coordinates, as from an IMU. By
            default the mounting's, for a level machine. Without both, it is estimated at
            each stem from the other stems, the ground and the camera.
        mounting: Transform from camera to machine coordinates (x forward, y left, z up).
        settings: Assumed errors and limits. Those of keypoints and mask edges are multiplied by
            `detections.error_factor`.
        rig_uncertainty: How well camera, depth, vertical and mounting are known. What it does not
            state is assumed, see `RigUncertainty`; `EXACT_RIG` is for simulated frames.
        sparse: Whether the depth is that of single beams, as `calib.clouds.depth_of_beams` gives
            it: what lies between them is not known. Widths then come from keypoints and masks
            alone, and settings of the depth's noise that are not given are those of a scanner.

    Returns:
        One measurement per detection, in their order. Quantities that cannot be measured hold the
        reason.

    Raises:
        InputError: Depth, camera or masks are for another image size, the depth does not have a
            float dtype or looks like millimetres, the camera is not one, or the vertical is not a
            valid direction.

    Examples:
        >>> from edgetree import TreeDetector, default_model, sample_frames
        >>> from edgetree.measure import measure_trees
        >>> frame = sample_frames()[0]
        >>> depth_m = frame.depth_m()
        >>> trees = TreeDetector.load(default_model("depth")).detect(depth_m)
        >>> stems = measure_trees(trees, depth_m, frame.camera, up_camera=frame.up_camera)
        >>> len(stems) == len(trees)
        True
        >>> all(stem.diameter_m or stem.diameter_m.reason for stem in stems)
        True
    """
    up = vertical_of(up_camera, mounting)
    settings = (settings or MeasureSettings()).scaled(detections.error_factor)
    settings = settings.of_beams() if sparse else settings
    uncertainty = rig_uncertainty or RigUncertainty()
    settings = uncertainty.in_settings(settings)
    frame = checked_frame(detections, depth_m, camera, masks, settings)
    if not len(detections):
        return []
    frame = replace(frame, rig=uncertainty.errors(camera), is_sparse=sparse)
    if detections.keypoints_px is None and frame.masks is None:
        reason = "the model gives neither keypoints nor masks"
        return [TreeMeasurement.failed(reason) for _ in range(len(detections))]
    # Values that are not finite are found and reported by `failure_reasons`.
    with np.errstate(all="ignore"):
        return _measure_all(frame, detections, up, mounting)


def _measure_all(
    frame: DepthFrame, trees: TreeDetections, up: Float | None, mounting: RigidTransform | None
) -> list[TreeMeasurement]:
    """Measure all trees of a frame.

    1. Choose the frame itself, or through lenses that bend straight lines, views of it.
    2. Observe edges, axis points and depth readings (`observe_stems`).
    3. Fit the direction of each axis in the image, then distance, tilt and width to the depth.
    4. Fit the ground around each sound stem, and take the vertical there.
    5. Compare the distances with the places where the feet meet the ground (`foot_distances`).
    6. Read the diameters along each stem.
    7. Compute all values of each tree.

    Args:
        frame: Depth, camera, masks and settings.
        trees: The detections, at least one.
        up: (3,) unit vector of the vertical; None estimates it from the stems, the ground and the
            camera.
        mounting: Transform from camera to machine coordinates.

    Returns:
        One measurement per detection, in their order.
    """
    views = stem_views(frame, trees)
    fits = [_fitted(view, up) for view in views]
    reasons = [fitted.failure_reasons() for fitted in fits]
    verticals = verticals_of(fits, reasons, up)
    found = [TreeMeasurement.failed("")] * len(trees)
    for view, fitted, why, up_there in zip(views, fits, reasons, verticals, strict=True):
        measured = _measured(fitted, why, up_there, mounting)
        for index, tree in zip(view.indices.tolist(), measured, strict=True):
            found[index] = tree
    return found


def _fitted(view: View, up: Float | None) -> FittedFrame:
    """Observe and fit the stems of a view; `up` (3,) is in the camera's axes."""
    settings = view.frame.settings
    frame, keypoints, observed = _observe(view)
    axes, roll_std_rad, lean_std_rad = axes_in_image(frame, observed, up)
    stems = fit_stems(observed.readings, axes, observed.edges, lean_std_rad, settings)
    return FittedFrame(
        frame=frame,
        keypoints=keypoints,
        observed=observed,
        stems=stems,
        roll_std_rad=roll_std_rad,
    )


def _observe(view: View) -> tuple[DepthFrame, Keypoints, StemObservations]:
    """Observe the stems of a view by their own part of the masks."""
    frame, keypoints = view.frame, view.keypoints
    wanted = ~keypoints.has_section | keypoints.unseen
    frame, boxes_px, straight = with_straight_parts(frame, view.boxes_px, wanted)
    keypoints = keypoints.without_foot(straight.above_foot)
    observed = observe_stems(frame, boxes_px, keypoints)
    if observed.outline is None:
        return frame, keypoints, observed
    frame, boxes_px, second = without_second_stems(frame, boxes_px, observed.outline, keypoints)
    if second.cut.any():
        observed = observe_stems(frame, boxes_px, keypoints)
    return frame, keypoints, replace(observed, straight=straight, second=second)


def axes_in_image(
    frame: DepthFrame, observed: StemObservations, up: Float | None
) -> tuple[StemAxes, Float, float]:
    """The axes in the image, as near to the vertical as they can be.

    Args:
        frame: The frame.
        observed: What it shows of T stems.
        up: (3,) the given vertical in the camera's axes.

    Returns:
        The axes, (T,) the deviations of their angles in the image, and that of a stem's lean from
        the vertical taken here, in rad.
    """
    vertical = frame.from_camera(np.array(CAMERA_UP) if up is None else up)
    up_std_rad = np.radians(CAMERA_UP_STD_DEG) if up is None else frame.rig.vertical_rad
    lean_std_rad = float(np.hypot(np.radians(frame.settings.lean_std_deg), up_std_rad))
    rays, std_rad = observed.axis_rays, observed.axis_std_rad
    return *fit_axes(rays, std_rad, vertical, lean_std_rad), lean_std_rad


def verticals_of(
    fits: Sequence[FittedFrame], reasons: list[list[str | None]], up: Float | None
) -> list[Verticals]:
    """The verticals for each view: given, or estimated from all sound stems and the camera.

    Args:
        fits: The fitted stems of each view.
        reasons: Why they cannot be measured, or None for sound ones.
        up: (3,) the given vertical.

    Returns:
        The verticals in the camera's axes; those of the view's own stems come first.
    """
    if up is not None:
        return [Verticals(up, fit.frame.rig.vertical_covariance(up)) for fit in fits]
    sound = np.array([reason is None for view in reasons for reason in view])
    axes = [fit.stems.sections.axes.mapped(fit.frame.to_camera) for fit in fits]
    roll_std_rad = np.concatenate([fit.roll_std_rad for fit in fits])
    common = Verticals.from_stems(
        StemAxes.joined(axes),
        np.where(sound, roll_std_rad, np.inf),
        np.concatenate([fit.stems.tilt_std_rad for fit in fits]),
        math.radians(fits[0].settings.lean_std_deg),
    )
    counts = [len(view) for view in reasons]
    firsts = np.cumsum([0, *counts[:-1]]).tolist()
    return [common.beginning_with(first) for first in firsts]


def _measured(
    fitted: FittedFrame,
    reasons: list[str | None],
    verticals: Verticals,
    mounting: RigidTransform | None,
) -> list[TreeMeasurement]:
    """The measurements of the stems of a view.

    Args:
        fitted: The fitted stems.
        reasons: Why they cannot be measured, or None for sound ones.
        verticals: The verticals in the camera's axes, those of these stems first.
        mounting: Transform from camera to machine coordinates.
    """
    frame = fitted.frame
    cuts = fitted.cut_points()
    grounds: list[BaseGround | Failure] = [Failure("")] * len(reasons)
    indices = np.flatnonzero([reason is None for reason in reasons])
    if len(indices):
        noise = noise_factor(fitted.observed.readings, STATIONS, fitted.settings)
        seen = verticals if frame.rotation is None else verticals.turned(frame.rotation)
        bases = fitted.bases(cuts)
        found = find_grounds(frame, bases.of(indices), seen, noise)
        for index, ground in zip(indices, found, strict=True):
            grounds[index] = ground
        seen_at_all = any(not isinstance(ground, UnseenGround) for ground in found)
        fitted = replace(fitted.against_feet(bases, grounds), ground_seen=seen_at_all)
        # The distances may have been corrected.
        cuts = fitted.cut_points()
        reasons = [reason or fitted.foot_failure(index) for index, reason in enumerate(reasons)]
    return values(fitted, cuts, reasons, grounds, verticals, mounting)


def values(
    fitted: FittedFrame,
    cuts: Float,
    reasons: list[str | None],
    grounds: list[BaseGround | Failure],
    verticals: Verticals,
    mounting: RigidTransform | None,
) -> list[TreeMeasurement]:
    """All values of the stems of a view.

    Args:
        fitted: The stems.
        cuts: (T, 3) axis points at their felling cuts.
        reasons: Why they cannot be measured, or None.
        grounds: Ground at each stem, in the frame's axes.
        verticals: The verticals in the camera's axes, those of these stems first.
        mounting: Transform from camera to machine coordinates.
    """
    frame = fitted.frame
    tapers = fitted.tapers(fitted.diameters(cuts, grounds), grounds)
    if frame.rotation is not None:
        back = frame.rotation.T
        grounds = [each.turned(back) if each else each for each in grounds]
    return [
        TreeMeasurement.failed(reason)
        if reason is not None
        else fitted.measurement(
            index, cuts[index], grounds[index], verticals, tapers[index], mounting
        )
        for index, reason in enumerate(reasons)
    ]
