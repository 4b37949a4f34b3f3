"""Trees in metres: from keypoints, masks, depth and camera."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib import PinholeCamera
from edgetree.detections import TreeDetections
from edgetree.errors import InputError
from edgetree.measure.estimates import TreeMeasurement
from edgetree.measure.frame import DepthFrame
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.tree import measure_tree

__all__ = ["measure_trees"]

Float = NDArray[np.floating[Any]]


def measure_trees(
    detections: TreeDetections,
    depth_m: NDArray[np.float32],
    camera: PinholeCamera,
    *,
    up_camera: ArrayLike | None = None,
    settings: MeasureSettings | None = None,
) -> list[TreeMeasurement]:
    """Measure every tree of one image.

    Args:
        detections: the trees, in this image's pixels, with keypoints; masks keep readings of
            what hides a stem out, and are not needed. A keypoint of score 0 is not used.
        depth_m: (H, W) float32 metres along the optical axis, 0 where it has no reading.
        camera: what took the depth, for this size of image.
        up_camera: (3,) direction away from gravity in the camera's frame, as an IMU gives it;
            without, heights and inclinations refer to the ground's plane.
        settings: assumed errors and limits.

    Returns:
        One measurement per detection, in their order. What cannot be measured says why.

    Raises:
        InputError: depth or camera are for another image size, or `up_camera` is no direction.
    """
    settings = settings or MeasureSettings()
    _check_sizes(detections, depth_m, camera)
    up = None if up_camera is None else _direction(up_camera)
    if detections.keypoints_px is None:
        reason = "the model gives no keypoints"
        return [TreeMeasurement.failed(reason) for _ in range(len(detections))]
    frame = DepthFrame.of(detections, depth_m, camera, settings)
    return [
        measure_tree(frame, index, detections.boxes_px[index], keypoints.astype(np.float64), up)
        for index, keypoints in enumerate(detections.keypoints_px)
    ]


def _check_sizes(detections: TreeDetections, depth_m: Float, camera: PinholeCamera) -> None:
    expected = (detections.image_width, detections.image_height)
    if depth_m.ndim != 2 or depth_m.shape[::-1] != expected:
        raise InputError(
            f"the depth map has shape {depth_m.shape}: expected {expected[::-1]}, as the image"
        )
    if (camera.width, camera.height) != expected:
        raise InputError(
            f"the camera is for {camera.width}x{camera.height} px: expected"
            f" {expected[0]}x{expected[1]} px, as the image"
        )


def _direction(up_camera: ArrayLike) -> Float:
    up = np.asarray(up_camera, np.float64)
    if up.shape != (3,) or not np.isfinite(up).all() or not np.linalg.norm(up) > 0:
        raise InputError(f"up_camera is {up.tolist()}: expected a direction of three numbers")
    return np.asarray(up / np.linalg.norm(up))
