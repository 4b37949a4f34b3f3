"""Check what a measurement is given: the sizes of depth, masks and camera, and the vertical."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Bool, Float
from basetree.errors import InputError
from calib import PinholeCamera, RigidTransform
from calib.directions import unit
from calib.transform import check_on_machine
from edgetree.detections import TreeDetections
from edgetree.measure.frame import DepthFrame
from edgetree.measure.settings import MeasureSettings

# A vertical with larger components than these, downwards in the image or along the optical axis,
# means that gravity was given in place of its opposite, or a mounting without the rotation from
# camera to machine axes: cameras are not upside down and do not look at the sky.
_MAX_DOWN, _MAX_FORWARD = 0.5, 0.9

# No stem is measured from a kilometre away, and no camera's picture has its middle nearer than the
# metre that this is in millimetres.
_FARTHEST_MEDIAN_M, _SAMPLED_ROWS = 1000.0, 16


def vertical_of(up_camera: ArrayLike | None, mounting: RigidTransform | None) -> Float | None:
    """(3,) the given vertical, or that of a level machine; None if neither is known.

    Raises:
        InputError: It is not a valid direction, or the camera stands far from the machine.
    """
    if mounting is not None and not isinstance(mounting, RigidTransform):
        raise InputError(
            f"the mounting is {type(mounting).__name__}: expected a RigidTransform, as"
            " calib.load_transform reads it"
        )
    if mounting is not None:
        check_on_machine(mounting, "the mounting")
    if up_camera is not None:
        return unit_up(up_camera)
    if mounting is None:
        return None
    try:
        return unit_up(mounting.inverse().rotate(np.array([0.0, 0.0, 1.0])))
    except InputError as error:
        raise InputError(f"by the mounting {error}") from error


def checked_frame(
    detections: TreeDetections,
    depth_m: Float,
    camera: PinholeCamera,
    masks: Sequence[Bool] | Bool | None,
    settings: MeasureSettings,
) -> DepthFrame:
    """The frame of some detections; arguments are those of `measure_trees`.

    Raises:
        InputError: Depth, camera or masks are for another image size, or of another kind.
    """
    _check_sizes(detections, depth_m, camera)
    if masks is not None:
        _check_masks(detections, masks)
    return DepthFrame.from_detections(detections, depth_m, camera, masks, settings)


def unit_up(up_camera: ArrayLike) -> Float:
    """Normalise the direction away from gravity.

    Args:
        up_camera: (3,) direction in camera coordinates.

    Returns:
        (3,) unit vector.

    Raises:
        InputError: The value is not a direction, or the camera would be upside down or look at
            the sky.
    """
    up = direction(up_camera)
    if up[1] > _MAX_DOWN or up[2] > _MAX_FORWARD:
        seen = "upside down" if up[1] > _MAX_DOWN else "at the sky"
        raise InputError(
            f"up is {np.round(up, 2).tolist()} in the camera's frame (x right, y down, z forward),"
            f" so that the camera looks {seen}: expected the direction away from gravity, or for a"
            " camera that is mounted upside down --rotate 180 (in Python Rig(rotation_deg=180))"
        )
    return up


def check_camera(camera: object) -> None:
    """Raise InputError if it is no camera."""
    if not isinstance(camera, PinholeCamera):
        raise InputError(
            f"the camera is {type(camera).__name__}: expected a PinholeCamera, as"
            " calib.load_camera reads it"
        )


def _check_sizes(detections: TreeDetections, depth_m: Float, camera: PinholeCamera) -> None:
    expected = (detections.image_width, detections.image_height)
    if not isinstance(depth_m, np.ndarray) or isinstance(depth_m, np.ma.MaskedArray):
        raise InputError(
            f"the depth map is {type(depth_m).__name__}: expected a plain numpy array of float"
            " metres, 0 where there is no reading"
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
    readings = depth_m[::_SAMPLED_ROWS, ::_SAMPLED_ROWS]
    # Most frames have no such reading.
    median_m = 0.0
    if (readings > _FARTHEST_MEDIAN_M).any():
        readings = readings[np.isfinite(readings) & (readings > 0)]
        median_m = float(np.median(readings)) if readings.size else 0.0
    if median_m > _FARTHEST_MEDIAN_M:
        raise InputError(
            f"the depth map has a median of {median_m:g} m: expected metres; this looks like"
            " millimetres, which become metres by `depth / 1000`"
        )
    check_camera(camera)
    if not camera.has_size:
        raise InputError(
            "the camera's file does not say how large its pictures are: expected"
            f" camera.scaled({expected[0]}, {expected[1]})"
        )
    if (camera.width, camera.height) != expected:
        raise InputError(
            f"the camera is for {camera.width}x{camera.height} px: expected"
            f" {expected[0]}x{expected[1]} px, as the image"
        )


def _check_masks(detections: TreeDetections, masks: Sequence[Bool] | Bool) -> None:
    if len(masks) != len(detections):
        raise InputError(f"there are {len(masks)} masks: expected {len(detections)}, one per tree")
    expected = (detections.image_height, detections.image_width)
    for mask in masks:
        if not isinstance(mask, np.ndarray):
            raise InputError(f"a mask is {type(mask).__name__}: expected an array of bool")
        if mask.shape != expected or mask.dtype != np.bool_:
            raise InputError(
                f"a mask has shape {mask.shape} of {mask.dtype}: expected {expected} of bool"
            )


def direction(up_camera: ArrayLike) -> Float:
    """(3,) unit vector of the direction away from gravity, wherever the camera looks.

    Raises:
        InputError: The value is not a direction.
    """
    try:
        up: Float = np.asarray(up_camera, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"up_camera is {up_camera!r:.100}: expected a direction of three numbers"
        ) from error
    if up.shape != (3,) or not np.isfinite(up).all() or not np.abs(up).max() > 0:
        raise InputError(f"up_camera is {up.tolist()}: expected a direction of three numbers")
    return unit(up / np.abs(up).max())
