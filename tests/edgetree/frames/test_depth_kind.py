"""The kind of a stream's depth is told by the ground of its first frames, once."""

from __future__ import annotations

import numpy as np

import calib
from edgetree.frames import Rig
from edgetree.frames.depth_kind import StreamDepthKind
from edgetree.frames.frame import Frame, stream_frame

CAMERA = calib.PinholeCamera(320, 240, fx=200.0, fy=200.0, cx=159.5, cy=119.5)
UP = np.array([0.05, -0.96, -0.27]) / np.linalg.norm([0.05, -0.96, -0.27])


def ground_m(seed: int) -> np.ndarray:
    """(H, W) depth of uneven ground 2 m below the camera."""
    rows, columns = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    falling = -(calib.pixels_to_rays(CAMERA, np.stack([columns, rows], -1) + 0.5) @ UP)
    depth_m = np.where(falling > 0.13, 2.0 / np.maximum(falling, 0.13), 0.0)
    noise = np.random.default_rng(seed).standard_normal(depth_m.shape)
    return (depth_m * (1 + 0.01 * noise)).astype(np.float32)


def said(rig: Rig, frames: list[np.ndarray]) -> list[str]:
    kind = StreamDepthKind(rig)
    given: list[Frame] = [
        stream_frame(number, number / 10, None, depth_m, CAMERA, UP)
        for number, depth_m in enumerate(frames)
    ]
    return [words for frame in given if (words := kind.words(frame)) is not None]


def test_range_read_as_depth_is_said_once_and_depth_is_not() -> None:
    depths = [ground_m(1000 + number % 7) for number in range(120)]
    ranges = [calib.depth_to_range(depth_m, CAMERA) for depth_m in depths[:7]]
    [words] = said(Rig(), [ranges[number % 7] for number in range(120)])
    assert "--depth-kind range" in words
    assert said(Rig(), depths) == []


def test_a_stream_without_ground_says_nothing() -> None:
    assert said(Rig(), [np.full((240, 320), 3.0, np.float32)] * 120) == []
