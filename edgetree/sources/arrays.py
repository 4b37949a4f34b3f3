"""Frames from the arrays that camera drivers hand over."""

from __future__ import annotations

from typing import Any, Final, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from basetree.errors import InputError
from edgetree.frames.frame import Frame, stream_frame
from edgetree.frames.rig import DepthReading, unit_vector

_TO_BGR: Final = {
    ("bgr", 3): None,
    ("bgr", 4): cv2.COLOR_BGRA2BGR,
    ("rgb", 3): cv2.COLOR_RGB2BGR,
    ("rgb", 4): cv2.COLOR_RGBA2BGR,
}


def frame_from_arrays(
    number: int,
    time_s: float,
    image: NDArray[Any] | None,
    depth: NDArray[Any] | None = None,
    *,
    depth_scale_m: float | calib.DepthScale | None = None,
    depth_kind: calib.DepthKind = "depth",
    colour_order: Literal["bgr", "rgb"] = "bgr",
    camera: calib.PinholeCamera | None = None,
    up_camera: ArrayLike | None = None,
    pose: calib.RigidTransform | None = None,
) -> Frame:
    """Make a frame of the arrays that a camera driver hands over.

    The arrays are copied, as drivers use their buffers again.

    Args:
        number: Number of the frame, from 0 on.
        time_s: Time stamp of the picture, s.
        image: (H, W, 3) or (H, W, 4) uint8 colour, or (H, W) uint8 grey; None if there is only
            depth.
        depth: (H, W) depth, aligned with the image, as integers or floating point. 0, NaN and
            infinity are no reading. None if there is only colour.
        depth_scale_m: Metres per unit of `depth`, by default 0.001 for integers and 1 for floating
            point; or the correction that `calib.load_depth_scale` reads.
        depth_kind: "depth" along the optical axis, or "range" along the ray of each pixel, which
            needs the camera.
        colour_order: "bgr" as OpenCV has it, or "rgb".
        camera: Intrinsics of the image. They are scaled to its size.
        up_camera: (3,) direction away from gravity in the camera's frame (x right, y down,
            z forward), of any length.
        pose: Transform from the camera's frame to a fixed frame with z up.

    Returns:
        The frame. If too little of the depth has readings, its `depth_fault` says so.

    Raises:
        InputError: An array has another shape or type, image and depth differ in size,
            floating-point depth is in millimetres without a scale, or a range has no camera.
        InputError: The camera is for another aspect ratio.
    """
    number, time_s = int(number), float(time_s)  # also numbers of numpy
    if image is None and depth is None:
        raise InputError(f"frame {number} has neither image nor depth: expected one of them")
    pixels = None if image is None else bgr_image(image, colour_order, f"image of frame {number}")
    shape = np.asarray(depth if pixels is None else pixels).shape[:2]
    if camera is not None and len(shape) == 2:
        is_of_size = camera.has_size and (camera.height, camera.width) == shape
        camera = camera if is_of_size else camera.scaled(shape[1], shape[0])
    depth_m, fault = None, None
    if depth is not None:
        convention = _convention(depth_scale_m, depth_kind)
        depth_m, fault = metres_from_array(depth, convention, f"depth of frame {number}", camera)
    if depth_m is not None and depth_m.shape != shape:
        raise InputError(
            f"depth of frame {number} is {depth_m.shape[1]}x{depth_m.shape[0]} px: expected"
            f" {shape[1]}x{shape[0]} px, like its image"
        )
    up = None if up_camera is None else unit_vector(up_camera)
    return stream_frame(number, float(time_s), pixels, depth_m, camera, up, pose, fault)


def _convention(
    scale_m: float | calib.DepthScale | None, kind: calib.DepthKind
) -> calib.DepthConvention:
    if isinstance(scale_m, calib.DepthScale):
        return calib.DepthConvention(None, kind, scale_m)
    return calib.DepthConvention(scale_m, kind)


def bgr_image(
    image: NDArray[Any], colour_order: Literal["bgr", "rgb"], name: str
) -> NDArray[np.uint8]:
    """Copy an image to (H, W, 3) uint8 BGR.

    Args:
        image: (H, W, 3) or (H, W, 4) uint8 colour, or (H, W) uint8 grey.
        colour_order: "bgr" or "rgb".
        name: What messages call it.

    Raises:
        InputError: The image has another shape or type, or the order is unknown.
    """
    if colour_order not in ("bgr", "rgb"):
        raise InputError(f"colour_order is {colour_order!r}: expected 'bgr' or 'rgb'")
    pixels = np.asarray(image)
    channels = 1 if pixels.ndim == 2 else pixels.shape[2] if pixels.ndim == 3 else 0
    if pixels.dtype != np.uint8 or channels not in (1, 3, 4) or pixels.size == 0:
        raise InputError(
            f"{name} has shape {pixels.shape} of {pixels.dtype}: expected (H, W, 3) of uint8"
        )
    code = cv2.COLOR_GRAY2BGR if channels == 1 else _TO_BGR[colour_order, channels]
    if code is None:
        return np.array(pixels, order="C")
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), code), np.uint8)


def metres_from_array(
    depth: NDArray[Any],
    convention: calib.DepthConvention,
    name: str,
    camera: calib.PinholeCamera | None = None,
) -> DepthReading:
    """Convert a depth array to metres.

    Args:
        depth: (H, W) integers or floating point.
        convention: Their unit, kind and correction.
        name: What messages call it.
        camera: The camera of these pixels, for a range.

    Raises:
        InputError: As for `calib.DepthConvention.metres`.
    """
    depth_m = convention.metres(np.asarray(depth), name, camera)
    check = calib.check_depth(depth_m)
    fault = f"{name}: {check.reason}" if isinstance(check, calib.DepthFailure) else None
    return DepthReading(depth_m, fault)
