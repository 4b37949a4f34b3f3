"""Frames from the arrays that camera drivers hand over."""

from __future__ import annotations

import math
from typing import Any, Final, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from basetree.errors import InputError
from calib.depth.files import in_metres
from edgetree.frames.frame import Frame, stream_frame
from edgetree.frames.rig import DepthReading, unit_vector

_MILLIMETRE_M: Final = 0.001
_MAX_MEDIAN_M: Final = 60.0  # as in `calib.check_depth`
_MAX_READING_M: Final = float(np.finfo(np.float32).max)
_SAMPLED_PIXELS: Final = 50_000
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
    depth_scale_m: float | None = None,
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
        depth: (H, W) depth along the optical axis, aligned with the image: uint16 in steps of
            `depth_scale_m`, or floating point in metres. 0, NaN and infinity are no reading. None
            if there is only colour.
        depth_scale_m: Metres per unit of `depth`. By default 0.001 for uint16 and 1 for floating
            point.
        colour_order: "bgr" as OpenCV has it, or "rgb".
        camera: Intrinsics of the image. They are scaled to its size.
        up_camera: (3,) direction away from gravity in the camera's frame (x right, y down,
            z forward), of any length.
        pose: Transform from the camera's frame to a fixed frame with z up.

    Returns:
        The frame. If too little of the depth has readings, its `depth_fault` says so.

    Raises:
        InputError: An array has another shape or type, image and depth differ in size, or
            floating-point depth is in millimetres.
        InputError: The camera is for another aspect ratio.
    """
    if image is None and depth is None:
        raise InputError(f"frame {number} has neither image nor depth: expected one of them")
    if not math.isfinite(time_s):
        raise InputError(f"time_s of frame {number} is {time_s}: expected seconds")
    pixels = None if image is None else bgr_image(image, colour_order, f"image of frame {number}")
    depth_m, fault = None, None
    if depth is not None:
        depth_m, fault = metres_from_array(depth, depth_scale_m, f"depth of frame {number}")
    height, width = (pixels if pixels is not None else np.asarray(depth)).shape[:2]
    if depth_m is not None and depth_m.shape != (height, width):
        raise InputError(
            f"depth of frame {number} is {depth_m.shape[1]}x{depth_m.shape[0]} px: expected"
            f" {width}x{height} px, like its image"
        )
    if camera is not None and (camera.width, camera.height) != (width, height):
        camera = camera.scaled(width, height)
    up = None if up_camera is None else unit_vector(up_camera)
    return stream_frame(number, float(time_s), pixels, depth_m, camera, up, pose, fault)


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


def metres_from_array(depth: NDArray[Any], depth_scale_m: float | None, name: str) -> DepthReading:
    """Convert a depth array to metres.

    Args:
        depth: (H, W) uint16 in steps of `depth_scale_m`, or floating point in metres.
        depth_scale_m: Metres per unit. By default 0.001 for uint16 and 1 for floating point.
        name: What messages call it.

    Raises:
        InputError: The array has another shape or type, the scale is not positive, or
            floating-point depth is in millimetres.
    """
    values = np.asarray(depth)
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    is_float = np.issubdtype(values.dtype, np.floating)
    if values.ndim != 2 or values.size == 0 or not (is_float or values.dtype == np.uint16):
        raise InputError(
            f"{name} has shape {values.shape} of {values.dtype}: expected (H, W) of uint16 with a"
            " scale, or of float32 in metres"
        )
    if depth_scale_m is not None and not (math.isfinite(depth_scale_m) and depth_scale_m > 0):
        raise InputError(f"depth_scale_m is {depth_scale_m}: expected metres per unit, above 0")
    if is_float:
        depth_m = _float_metres(values, 1.0 if depth_scale_m is None else depth_scale_m)
        if depth_scale_m is None:
            _refuse_millimetres(depth_m, name)
    else:
        depth_m = in_metres(values, depth_scale_m or _MILLIMETRE_M)
    check = calib.check_depth(depth_m)
    fault = f"{name}: {check.reason}" if isinstance(check, calib.DepthFailure) else None
    return DepthReading(depth_m, fault)


def _float_metres(values: NDArray[Any], scale: float) -> NDArray[np.float32]:
    """Metres of floating-point depth; 0 where there is no reading, as `calib.read_depth` does."""
    with np.errstate(invalid="ignore", over="ignore"):
        metres = values if scale == 1.0 else values * scale
        usable = (metres > 0) & (metres <= _MAX_READING_M)
        return np.where(usable, metres, 0).astype(np.float32)


def _refuse_millimetres(depth_m: NDArray[np.float32], name: str) -> None:
    sampled = depth_m.ravel()[:: max(1, depth_m.size // _SAMPLED_PIXELS)]
    readings = sampled[sampled > 0]
    median = float(np.median(readings)) if readings.size else 0.0
    if median > _MAX_MEDIAN_M:
        raise InputError(
            f"{name} is floating point with a median of {median:g}: expected metres; this looks"
            " like millimetres: divide by 1000, or pass depth_scale_m=0.001"
        )
