"""Orbbec cameras, with the package pyorbbecsdk2.

Tested against a fake of pyorbbecsdk that follows its documentation, never against a device.
"""

from __future__ import annotations

import logging
from contextlib import suppress
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from basetree.files.reading import decode_image
from calib.files import fields
from edgetree.frames.frame import Frame
from edgetree.sources.cameras.device import Device, load_sdk
from edgetree.sources.source import FrameSource

_log = logging.getLogger(__name__)

_US_PER_S: Final = 1_000_000
_MM_PER_M: Final = 1000
_POLL_MS: Final = 200
_TERMS: Final = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # in OpenCV's order
_MODELS: Final = ("NONE", "BROWN_CONRADY", "BROWN_CONRADY_K6")  # those that OpenCV has


def open_orbbec(*, up_camera: ArrayLike | None = None) -> FrameSource:
    """Open an Orbbec camera: colour, depth aligned with it, intrinsics and gravity.

    Args:
        up_camera: (3,) direction away from gravity in the camera's frame, for cameras without an
            accelerometer. An accelerometer's direction takes its place.

    Returns:
        The source. Its time stamps are those of the computer at which frames arrived.

    Raises:
        SourceLost: There is no such camera, or it does not start.
        MissingPackage: pyorbbecsdk2 is not installed.
    """
    return _Orbbec(load_sdk("pyorbbecsdk", "pyorbbecsdk2", "orbbec", "Orbbec"), up_camera)


class _Orbbec(Device):
    def __init__(self, sdk: Any, up_camera: ArrayLike | None) -> None:
        self._sdk = sdk
        self._motion: Any = None
        super().__init__("orbbec", up_camera, (RuntimeError, sdk.OBError))

    def _start(self) -> None:
        sdk = self._sdk
        self._pipeline = sdk.Pipeline()
        config = sdk.Config()
        colours = self._pipeline.get_stream_profile_list(sdk.OBSensorType.COLOR_SENSOR)
        depths = self._pipeline.get_stream_profile_list(sdk.OBSensorType.DEPTH_SENSOR)
        self._colour_profile = colours.get_default_video_stream_profile()
        config.enable_stream(self._colour_profile)
        config.enable_stream(depths.get_default_video_stream_profile())
        config.set_frame_aggregate_output_mode(sdk.OBFrameAggregateOutputMode.FULL_FRAME_REQUIRE)
        with suppress(*self._errors):  # not all cameras can; pairs are complete without it
            self._pipeline.enable_frame_sync()
        self._pipeline.start(config)
        self._align = sdk.AlignFilter(align_to_stream=sdk.OBStreamType.COLOR_STREAM)
        self._start_motion()

    def _start_motion(self) -> None:
        """Start the accelerometer in a pipeline of its own, as its rate is another one."""
        sdk = self._sdk
        device = self._pipeline.get_device()
        try:
            device.get_sensor(sdk.OBSensorType.ACCEL_SENSOR)
            config = sdk.Config()
            config.enable_accel_stream()
            motion = sdk.Pipeline(device)
            motion.start(config, self._take_motion)
        except self._errors as error:
            _log.warning("orbbec: the accelerometer is not used: %s", error)
            return
        self._motion = motion

    def _stop(self) -> None:
        try:
            if self._motion is not None:
                self._motion.stop()
        finally:
            self._pipeline.stop()

    def _poll(self) -> Frame | None:
        frames = self._pipeline.wait_for_frames(_POLL_MS)
        aligned = None if frames is None else self._align.process(frames)
        if aligned is None:
            return None
        aligned = aligned.as_frame_set()
        colour, depth = aligned.get_color_frame(), aligned.get_depth_frame()
        if colour is None or depth is None:
            self.counts["colour without depth"] += 1
            return None
        return self._frame(colour, depth)

    def _take_motion(self, frames: Any) -> None:
        """Give a reading to the filter. Called in a thread of the SDK."""
        frame = frames.get_frame(self._sdk.OBFrameType.ACCEL_FRAME)
        if frame is None:
            return
        accel = frame.as_accel_frame()
        if self._imu_to_camera is None:
            profile = accel.get_stream_profile()
            turned = profile.get_extrinsic_to(self._colour_profile).rot
            self._imu_to_camera = np.reshape(turned, (3, 3)).astype(np.float64)
        push = np.array([accel.get_x(), accel.get_y(), accel.get_z()], np.float64)
        self._gravity.add(accel.get_system_timestamp_us() / _US_PER_S, push)

    def _frame(self, colour: Any, depth: Any) -> Frame | None:
        image = self._bgr(colour)
        if image is None:
            self.counts["unreadable images"] += 1
            return None
        values = np.frombuffer(depth.get_data(), np.uint16)
        return self._frame_of(
            int(colour.get_index()),
            colour.get_system_timestamp_us() / _US_PER_S,
            image,
            values.reshape(depth.get_height(), depth.get_width()),
            depth.get_depth_scale() / _MM_PER_M,
            self._intrinsics,
        )

    def _bgr(self, colour: Any) -> NDArray[Any] | None:
        """The picture as BGR; None if it cannot be decoded."""
        formats, form = self._sdk.OBFormat, colour.get_format()
        data = np.frombuffer(colour.get_data(), np.uint8)
        if form == formats.MJPG:
            return decode_image(data)
        shape = (colour.get_height(), colour.get_width())
        codes = {
            formats.RGB: (3, cv2.COLOR_RGB2BGR),
            formats.BGR: (3, None),
            formats.YUYV: (2, cv2.COLOR_YUV2BGR_YUYV),
            formats.UYVY: (2, cv2.COLOR_YUV2BGR_UYVY),
        }
        if form not in codes:
            raise RuntimeError(f"its colour is {form}, expected MJPG, RGB, BGR, YUYV or UYVY")
        channels, code = codes[form]
        pixels = data.reshape(*shape, channels)
        return pixels if code is None else np.asarray(cv2.cvtColor(pixels, code))

    def _intrinsics(self) -> calib.PinholeCamera | None:
        found = self._colour_profile.get_intrinsic()
        lens = self._colour_profile.get_distortion()
        terms = [float(getattr(lens, name)) for name in _TERMS]
        model = str(lens.model.name)
        if model not in _MODELS and any(terms):
            _log.warning(
                "orbbec: its lens model is %s, expected Brown Conrady: calibrate the camera with a"
                " board",
                model,
            )
            return None
        return fields.camera(
            (found.width, found.height), (found.fx, found.fy, found.cx, found.cy), terms
        )
