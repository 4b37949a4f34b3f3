"""Measure the trees of a picture without depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Bool, Float
from basetree.errors import InputError
from calib import PinholeCamera, RigidTransform
from edgetree.detections import TreeDetections
from edgetree.measure.entry import axes_in_image, values, verticals_of
from edgetree.measure.estimates import TreeMeasurement
from edgetree.measure.inputs import check_camera, checked_frame, vertical_of
from edgetree.measure.observations import observe_stems
from edgetree.measure.rig_uncertainty import RigUncertainty
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.views import View, stem_views
from edgetree.measure.without_depth.placed_frame import PlacedFrame, seen_only
from edgetree.measure.without_depth.placement import Way


def measure_without_depth(
    detections: TreeDetections,
    camera: PinholeCamera,
    ways: Sequence[Way],
    *,
    masks: Sequence[Bool] | Bool | None = None,
    up_camera: ArrayLike | None = None,
    mounting: RigidTransform | None = None,
    settings: MeasureSettings | None = None,
    rig_uncertainty: RigUncertainty | None = None,
) -> list[TreeMeasurement]:
    """Measure every tree of one image by another way to its distance than depth.

    Widths, tapers and their errors are those of `measure_trees`. The distance comes from the way
    that states the smallest error of sizes at a stem, and `Evidence.distance_from` names it. Of
    the lean only the part across the view is seen, so there is no inclination.

    Args:
        detections: The N trees, as for `measure_trees`.
        camera: Intrinsics of the picture.
        ways: What tells distances, at least one, such as `CameraHeight`.
        masks: As for `measure_trees`, and so are the others.
        up_camera: (3,) direction away from gravity in camera coordinates.
        mounting: Transform from camera to machine coordinates.
        settings: Assumed errors and limits.
        rig_uncertainty: How well camera and vertical are known.

    Returns:
        One measurement per detection, in their order.

    Raises:
        InputError: Camera or masks are for another image size, the vertical is not a valid
            direction, or there is no way.

    Examples:
        >>> from edgetree import TreeDetector, default_model, sample_frames
        >>> from edgetree.measure import CameraHeight, measure_without_depth
        >>> frame = sample_frames()[0]
        >>> trees = TreeDetector.load(default_model("rgb")).detect(frame.image())
        >>> ways = [CameraHeight(2.6, height_std_m=0.1)]
        >>> stems = measure_without_depth(trees, frame.camera, ways, up_camera=frame.up_camera)
        >>> all(stem.diameter_m or stem.diameter_m.reason for stem in stems)
        True
    """
    check_camera(camera)
    if not ways:
        raise InputError("there is no way to distances without depth: expected one or more")
    up = vertical_of(up_camera, mounting)
    settings = (settings or MeasureSettings()).scaled(detections.error_factor)
    no_depth_m = np.zeros((camera.height, camera.width), np.float32)
    frame = checked_frame(detections, no_depth_m, camera, masks, settings)
    if not len(detections):
        return []
    rig = (rig_uncertainty or RigUncertainty()).errors(camera)
    frame = replace(frame, rig=replace(rig, scale=0.0, placed=True))
    if detections.keypoints_px is None and frame.masks is None:
        reason = "the model gives neither keypoints nor masks"
        return [_placed_nowhere(TreeMeasurement.failed(reason)) for _ in range(len(detections))]
    # Values that are not finite are found and reported as failures.
    with np.errstate(all="ignore"):
        return _measured(stem_views(frame, detections), list(ways), up, mounting)


def _placed_nowhere(tree: TreeMeasurement) -> TreeMeasurement:
    """A failed measurement, whose distance comes from nothing, and not from depth."""
    return replace(tree, evidence=replace(tree.evidence, distance_from=""))


def _measured(
    views: list[View], ways: list[Way], up: Float | None, mounting: RigidTransform | None
) -> list[TreeMeasurement]:
    """The measurements of all stems of some views, in the order of their numbers."""
    unplaced = [_unplaced(view, up) for view in views]
    verticals = verticals_of(unplaced, [fit.failure_reasons() for fit in unplaced], up)
    found: dict[int, TreeMeasurement] = {}
    for view, fit, own in zip(views, unplaced, verticals, strict=True):
        seen = own if view.frame.rotation is None else own.turned(view.frame.rotation)
        placed = fit.placed(ways, seen)
        grounds = placed.grounds(seen)
        reasons = placed.failure_reasons()
        trees = [
            tree if why is None else _placed_nowhere(tree)
            for tree, why in zip(
                values(placed, placed.cut_points(), reasons, grounds, own, mounting),
                reasons,
                strict=True,
            )
        ]
        found |= zip(view.indices.tolist(), trees, strict=True)
    return [found[index] for index in range(len(found))]


def _unplaced(view: View, up: Float | None) -> PlacedFrame:
    """The stems of a view at 1 m; `up` (3,) is in the camera's axes."""
    frame = view.frame
    observed = observe_stems(frame, view.boxes_px, view.keypoints)
    axes, roll_std_rad, lean_std_rad = axes_in_image(frame, observed, up)
    sections, sources, _ = observed.edges.sections(axes)
    ones = np.ones(len(view.indices))
    stems = seen_only(observed, sections, sources, ones, lean_std_rad * ones)
    return PlacedFrame(
        frame=frame,
        keypoints=view.keypoints,
        observed=observed,
        stems=stems,
        roll_std_rad=roll_std_rad,
        numbers=view.indices,
    )
