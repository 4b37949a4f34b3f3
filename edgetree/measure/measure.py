"""Measure the trees of one image: check the input and start the measurement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from basetree.errors import InputError
from calib import PinholeCamera, RigidTransform
from edgetree.detections import TreeDetections
from edgetree.measure.estimates import TreeMeasurement
from edgetree.measure.frame import DepthFrame
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.trees import measure_all

__all__ = ["measure_trees"]

Float = NDArray[np.floating[Any]]

# A vertical with larger components than these, downwards in the image or along the optical axis,
# means that gravity was given in place of its opposite, or a mounting without the rotation from
# camera to machine axes: cameras are not upside down and do not look at the sky.
_MAX_DOWN, _MAX_FORWARD = 0.5, 0.9


def measure_trees(
    detections: TreeDetections,
    depth_m: NDArray[np.float32],
    camera: PinholeCamera,
    *,
    masks: Sequence[NDArray[np.bool_]] | NDArray[np.bool_] | None = None,
    up_camera: ArrayLike | None = None,
    mounting: RigidTransform | None = None,
    settings: MeasureSettings | None = None,
) -> list[TreeMeasurement]:
    """Measure every tree of one image.

    Args:
        detections: the N trees, in pixels of this image, with keypoints, masks or both.
            Keypoints with score 0 are not used.
        depth_m: (H, W) depth z along the optical axis in metres, of a float dtype; 0, NaN or
            infinite where there is no reading.
        camera: intrinsics of the depth map, for this image size.
        masks: (N, H, W) bool masks that replace those of the detections, for example drawn by
            hand or from another segmentation.
        up_camera: (3,) direction away from gravity in camera coordinates, as from an IMU. By
            default the mounting's, for a level machine. Without both, heights and inclinations
            refer to the normal of the ground plane.
        mounting: transform from camera to machine coordinates (x forward, y left, z up).
        settings: assumed errors and limits. Those of keypoints and mask edges are multiplied by
            `detections.error_factor`.

    Returns:
        One measurement per detection, in their order. Quantities that cannot be measured hold the
        reason.

    Raises:
        InputError: depth, camera or masks are for another image size, the depth does not have a
            float dtype, or the vertical is not a valid direction.
    """
    settings = (settings or MeasureSettings()).scaled(detections.error_factor)
    _check_sizes(detections, depth_m, camera)
    if masks is not None:
        _check_masks(detections, masks)
    up = None if up_camera is None else unit_up(up_camera)
    if up is None and mounting is not None:
        up = unit_up(mounting.inverse().rotate(np.array([0.0, 0.0, 1.0])))
    if not len(detections):
        return []
    frame = DepthFrame.of(detections, depth_m, camera, masks, settings)
    if detections.keypoints_px is None and frame.masks is None:
        reason = "the model gives neither keypoints nor masks"
        return [TreeMeasurement.failed(reason) for _ in range(len(detections))]
    return measure_all(frame, detections, up, mounting)


def _check_sizes(detections: TreeDetections, depth_m: Float, camera: PinholeCamera) -> None:
    expected = (detections.image_width, detections.image_height)
    if not isinstance(depth_m, np.ndarray):
        raise InputError(
            f"the depth map is {type(depth_m).__name__}: expected a numpy array of float metres"
        )
    if depth_m.ndim != 2 or depth_m.shape[::-1] != expected:
        raise InputError(
            f"the depth map has shape {depth_m.shape}: expected {expected[::-1]}, as the image"
        )
    if not np.issubdtype(depth_m.dtype, np.floating):
        raise InputError(
            f"the depth map holds {depth_m.dtype}: expected float metres (16-bit millimetres are"
            " read with calib.read_depth)"
        )
    if (camera.width, camera.height) != expected:
        raise InputError(
            f"the camera is for {camera.width}x{camera.height} px: expected"
            f" {expected[0]}x{expected[1]} px, as the image"
        )


def _check_masks(
    detections: TreeDetections, masks: Sequence[NDArray[np.bool_]] | NDArray[np.bool_]
) -> None:
    if len(masks) != len(detections):
        raise InputError(f"there are {len(masks)} masks: expected {len(detections)}, one per tree")
    expected = (detections.image_height, detections.image_width)
    for mask in masks:
        if mask.shape != expected or mask.dtype != np.bool_:
            raise InputError(
                f"a mask has shape {mask.shape} of {mask.dtype}: expected {expected} of bool"
            )


def unit_up(up_camera: ArrayLike) -> Float:
    """Normalise the direction away from gravity.

    Args:
        up_camera: (3,) direction in camera coordinates.

    Returns:
        (3,) unit vector.

    Raises:
        InputError: the value is not a direction, or the camera would be upside down or look at
            the sky.
    """
    up = np.asarray(up_camera, np.float64)
    if up.shape != (3,) or not np.isfinite(up).all() or not np.abs(up).max() > 0:
        raise InputError(f"up_camera is {up.tolist()}: expected a direction of three numbers")
    up = up / np.abs(up).max()
    up = np.asarray(up / np.linalg.norm(up))
    if up[1] > _MAX_DOWN or up[2] > _MAX_FORWARD:
        seen = "upside down" if up[1] > _MAX_DOWN else "at the sky"
        raise InputError(
            f"up is {np.round(up, 2).tolist()} in the camera's frame (x right, y down, z forward),"
            f" so that the camera looks {seen}: expected the direction away from gravity"
        )
    return up
