"""Drives for testing: the package's sample frames as a panning camera, with or without faults."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera
from edgetree import sample_frames
from edgetree.frames.frame import Frame, stream_frame

Float32 = NDArray[np.float32]

WIDTH, HEIGHT = 640, 360
PERIOD_S = 0.1
_PAN_PX = 6
_TOP = 200


class GivenSource:
    """A source of given frames."""

    is_live = False
    name = "given"

    def __init__(self, frames: list[Frame]) -> None:
        self._frames = frames
        self.counts: dict[str, int] = {}
        self.is_closed = False

    def __iter__(self) -> Iterator[Frame]:
        yield from self._frames

    def close(self) -> None:
        self.is_closed = True


def warp_depth(depth_m: Float32, x: float = 0, size: float = 1, turn_deg: float = 0) -> Float32:
    """Depth shifted to the right, resized and turned clockwise."""
    height, width = depth_m.shape
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), -turn_deg, size)
    matrix[0, 2] += x
    moved = cv2.warpAffine(depth_m, matrix, (width, height), flags=cv2.INTER_NEAREST)
    return np.asarray(moved, np.float32)


def panning_drive(
    seconds: float = 12.0,
    *,
    late: int = 0,
    change: Callable[[Float32], Float32] | None = None,
) -> list[Frame]:
    """A window of half the width pans over each sample frame, to and fro.

    Args:
        seconds: length.
        late: by how many frames the depth is late.
        change: applied to the depth of each window.
    """
    frames: list[Frame] = []
    wide = _pictures()
    for number in range(round(seconds / PERIOD_S)):
        camera, wide_image, wide_depth_m = wide[number // 20 % len(wide)]
        step = number % 20
        image = _window(wide_image, step)
        depth_m = _window(wide_depth_m, max(step - late, 0))
        fx = camera.fx
        frames.append(
            stream_frame(
                number,
                number * PERIOD_S,
                image,
                depth_m if change is None else change(depth_m),
                PinholeCamera(WIDTH, HEIGHT, fx, fx, (WIDTH - 1) / 2, (HEIGHT - 1) / 2),
            )
        )
    return frames


@lru_cache
def _pictures() -> list[tuple[PinholeCamera, NDArray[np.uint8], Float32]]:
    return [(each.camera, each.image(), each.depth_m()) for each in sample_frames()]


def _window(picture: NDArray[Any], step: int) -> NDArray[Any]:
    """The window at a step: it goes to the right for 10 steps, then back."""
    left = 320 + _PAN_PX * min(step, 20 - step)
    return np.ascontiguousarray(picture[_TOP : _TOP + HEIGHT, left : left + WIDTH])


def without(frames: list[Frame], name: str) -> list[Frame]:
    """The frames without their image, depth or camera."""
    nothing: dict[str, Any] = {name: None}
    return [replace(frame, **nothing) for frame in frames]
