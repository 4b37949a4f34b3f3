"""Cameras that OpenCV reads: V4L2 devices, network streams and GStreamer pipelines."""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Iterator
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from basetree.errors import InputError
from basetree.secrets import hide_secrets
from edgetree.frames.frame import Frame, stream_frame
from edgetree.frames.rig import unit_vector
from edgetree.sources.arrays import bgr_image
from edgetree.sources.source import BaseSource, FrameSource, SourceLost

_log = logging.getLogger(__name__)

_OPEN_TIMEOUT_S: Final = 10.0
_FRAME_TIMEOUT_S: Final = 5.0
_NO_FIT: Final = "pictures of another shape than the camera file"
_CLOSE_TIMEOUT_S: Final = 0.8
_MS: Final = 1000


def open_camera(
    address: int | str,
    *,
    camera: calib.PinholeCamera | None = None,
    up_camera: ArrayLike | None = None,
) -> FrameSource:
    """Open a camera through OpenCV. One thread keeps the newest frame; older ones are replaced.

    Args:
        address: Number of a V4L2 device, an address such as rtsp://camera/1 or http://camera/video,
            or a GStreamer pipeline that ends in appsink, if OpenCV was built with GStreamer.
        camera: Intrinsics; devices are asked for pictures of its size.
        up_camera: (3,) direction away from gravity in the camera's frame.

    Returns:
        The source. Its time stamps are when a frame arrived, s since 1970, and never fall.

    Raises:
        SourceLost: The camera does not answer.
        InputError: The address is not of ASCII, or OpenCV was built without GStreamer.
        CameraError: During iteration, if `camera` is for another aspect ratio.
    """
    up = None if up_camera is None else unit_vector(up_camera)
    return _Camera(address, camera, up)


class _Camera(BaseSource):
    """A camera and the thread that reads it."""

    is_live = True

    def __init__(
        self,
        address: int | str,
        camera: calib.PinholeCamera | None,
        up: NDArray[np.float64] | None,
    ) -> None:
        super().__init__(f"camera {hide_secrets(str(address))}")
        self.counts["replaced by newer frames"] = 0
        self._camera, self._up = camera, up
        self._start_s = time.time() - time.monotonic()
        self._changed = threading.Condition()
        self._newest: tuple[int, float, NDArray[Any]] | None = None
        self._is_lost = self._has_fitted = False
        capture = _open(address, self.name, camera)
        self._reader = threading.Thread(
            target=self._read, args=(capture,), name=self.name, daemon=True
        )
        self._reader.start()

    def __iter__(self) -> Iterator[Frame]:
        while True:
            with self._changed:
                self._changed.wait_for(self._has_news, _FRAME_TIMEOUT_S)
                if self._is_closed.is_set():
                    return
                newest, self._newest = self._newest, None
            if newest is None:
                raise SourceLost(f"{self.name} sends no frames any more: expected it to be there")
            try:
                frame = self._frame(*newest)
            except calib.CameraError as error:
                if not self._has_fitted:
                    raise
                self._leave_out(error)
                continue
            self._has_fitted = True
            yield frame

    def close(self) -> None:
        """Release the camera, within a second."""
        with self._changed:
            super().close()
            self._changed.notify_all()
        # A reader that waits for a dead network releases the camera when its wait ends.
        self._reader.join(_CLOSE_TIMEOUT_S)

    def _frame(self, number: int, time_s: float, picture: NDArray[Any]) -> Frame:
        image = bgr_image(picture, "bgr", f"picture of {self.name}")
        camera = self._camera
        if camera is not None:
            try:
                camera = camera.scaled(image.shape[1], image.shape[0])
            except calib.CameraError as error:
                raise calib.CameraError(f"{self.name}: {error}") from error
        return stream_frame(number, time_s, image, None, camera, self._up)

    def _leave_out(self, error: calib.CameraError) -> None:
        """Count a picture that does not fit the camera file although earlier ones did."""
        if self.counts[_NO_FIT] == 0:
            _log.warning("frames left out: %s", error)
        self.counts[_NO_FIT] += 1

    def _has_news(self) -> bool:
        return self._is_closed.is_set() or self._is_lost or self._newest is not None

    def _read(self, capture: cv2.VideoCapture) -> None:
        """Read frames until the camera is closed or lost. Runs in a thread."""
        number = 0
        while not self._is_closed.is_set():
            try:
                is_there, picture = capture.read()
            except cv2.error as error:
                _log.warning("%s: %s", self.name, error)
                is_there, picture = False, None
            with self._changed:
                if is_there and picture is not None:
                    if self._newest is not None:
                        self.counts["replaced by newer frames"] += 1
                    self._newest = (number, self._start_s + time.monotonic(), picture)
                else:
                    self._is_lost = True
                self._changed.notify_all()
            if self._is_lost:
                break
            number += 1
        capture.release()


def _open(address: int | str, name: str, camera: calib.PinholeCamera | None) -> cv2.VideoCapture:
    if isinstance(address, int):
        capture = cv2.VideoCapture(address)
        if camera is not None:
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, camera.width)
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, camera.height)
    elif not (address.isprintable() and address.isascii()):  # OpenCV crashes on some others
        raise InputError(f"{name!r} is no address: expected printable ASCII")
    elif "!" in address and not re.match(r"\w+://", address):
        if not cv2.videoio_registry.hasBackend(cv2.CAP_GSTREAMER):
            raise InputError(
                f"{name} is a GStreamer pipeline and this OpenCV was built without GStreamer:"
                " expected a device number or an address"
            )
        capture = cv2.VideoCapture(address, cv2.CAP_GSTREAMER)
    else:
        timeouts = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
            round(_OPEN_TIMEOUT_S * _MS),
            cv2.CAP_PROP_READ_TIMEOUT_MSEC,
            round(_FRAME_TIMEOUT_S * _MS),
        ]
        capture = cv2.VideoCapture(address, cv2.CAP_FFMPEG, timeouts)
    if not capture.isOpened():
        capture.release()
        raise SourceLost(f"{name} cannot be opened: expected a camera that answers")
    return capture
