"""What cameras with a package of their maker have in common."""

from __future__ import annotations

import importlib
import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from basetree.errors import MissingPackage, install_hint
from edgetree.frames.frame import Frame
from edgetree.frames.rig import unit_vector
from edgetree.sources.arrays import frame_from_arrays
from edgetree.sources.gravity import GravityFilter
from edgetree.sources.source import BaseSource, SourceLost

_log = logging.getLogger(__name__)

_FRAME_TIMEOUT_S: Final = 5.0


def load_sdk(module: str, package: str, extra: str, cameras: str) -> Any:
    """Import the package of a maker.

    Args:
        module: Name of the module.
        package: Name of the package.
        extra: The extra of this project that installs it.
        cameras: The cameras that need it.

    Raises:
        MissingPackage: It is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingPackage(
            f"{package} is not installed, which {cameras} cameras need: {install_hint(extra)}"
        ) from error


class Device(ABC, BaseSource):
    """A camera that streams until it is closed.

    Args:
        name: What messages call it.
        up_camera: (3,) direction away from gravity in the camera's frame, until an IMU gives it.
        errors: What the maker's package raises if the camera fails.
    """

    is_live = True

    def __init__(
        self, name: str, up_camera: ArrayLike | None, errors: tuple[type[Exception], ...]
    ) -> None:
        super().__init__(name)
        self._errors = errors
        self._given_up = None if up_camera is None else unit_vector(up_camera)
        self._first: int | None = None  # number of the first frame
        self._camera: calib.PinholeCamera | None = None
        self._gravity = GravityFilter()
        self._imu_to_camera: NDArray[np.float64] | None = None
        try:
            self._start()
        except errors as error:
            raise SourceLost(
                f"{name} cannot be opened ({error}): expected a camera that answers"
            ) from error

    def __iter__(self) -> Iterator[Frame]:
        heard_s = time.monotonic()
        while not self._is_closed.is_set():
            try:
                frame = self._poll()
            except self._errors as error:
                if self._is_closed.is_set():
                    return
                raise SourceLost(
                    f"{self.name} stopped ({error}): expected it to be there"
                ) from error
            if frame is not None:
                heard_s = time.monotonic()
                yield frame
            elif time.monotonic() - heard_s > _FRAME_TIMEOUT_S:
                raise SourceLost(
                    f"{self.name} sent no frames for {_FRAME_TIMEOUT_S:g} s: expected it to be"
                    " there"
                )

    def close(self) -> None:
        """Stop the camera."""
        if not self._is_closed.is_set():
            self._is_closed.set()
            with suppress(*self._errors):  # a camera that was unplugged cannot be stopped
                self._stop()

    def _frame_of(
        self,
        number: int,
        time_s: float,
        image: NDArray[Any],
        depth: NDArray[Any],
        depth_scale_m: float,
        intrinsics: Callable[[], calib.PinholeCamera | None],
    ) -> Frame:
        """A frame of the camera's arrays.

        Args:
            number: Number that the camera gives the frame.
            time_s: Time stamp, s.
            image: (H, W, 3) uint8 BGR.
            depth: (H, W) uint16, aligned with the image.
            depth_scale_m: Metres per unit of the depth.
            intrinsics: Finds the intrinsics of the image, once.
        """
        if self._first is None:
            self._first = number
            try:
                self._camera = intrinsics()
            except calib.CameraError as error:
                _log.warning("%s: its intrinsics are not used: %s", self.name, error)
        return frame_from_arrays(
            number - self._first,
            time_s,
            image,
            depth,
            depth_scale_m=depth_scale_m,
            camera=self._camera,
            up_camera=self._up(time_s),
        )

    def _up(self, time_s: float) -> NDArray[np.float64] | None:
        """The direction away from gravity in the camera's frame."""
        level = self._gravity.up(time_s)
        if level is None or self._imu_to_camera is None:
            return self._given_up
        return np.asarray(self._imu_to_camera @ level, np.float64)

    @abstractmethod
    def _start(self) -> None:
        """Start the streams."""

    @abstractmethod
    def _stop(self) -> None:
        """Stop the streams."""

    @abstractmethod
    def _poll(self) -> Frame | None:
        """The next frame; None if none has come in a fraction of a second."""
