"""Stereo pairs as sources: two pictures, or two folders or videos, with their calibration."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

import calib
from basetree.counts import counted
from basetree.errors import InputError
from calib.stereo import Rectified, StereoDepth, StereoPair
from edgetree.frames.frame import DepthNoise, Frame
from edgetree.frames.rig import Rig, unit_vector
from edgetree.sources.files import open_source
from edgetree.sources.source import BaseSource, FrameSource

_log = logging.getLogger(__name__)

_BIAS_PX: Final = 0.03
"""Disparity error that all readings on one stem share, px: what is left of the pull to whole
pixels. Source: chosen, the largest on shifted pictures of a known shift."""

_CORRELATION_PX: Final = 8.0
"""Readings nearer than this share their error. Source: bound, the blocks have 7 px."""

_LEAST_NOISE_M: Final = 0.001


def stereo_noise(found: StereoDepth, rectified: Rectified) -> DepthNoise:
    """The errors of a frame's depth: the median deviation of its disparities, z² / (f b) each."""
    matched = found.depth_m > 0
    per_m = found.std_m[matched] / found.depth_m[matched].astype(np.float64) ** 2
    noise_per_m = float(np.median(per_m)) if per_m.size else 1 / rectified.focal_baseline
    return DepthNoise(
        noise_per_m, _LEAST_NOISE_M, _BIAS_PX / rectified.focal_baseline, _CORRELATION_PX
    )


def stereo_rig(rig: Rig, pair: StereoPair) -> Rig:
    """The rig of the rectified left camera, whose intrinsics come with each frame.

    Args:
        rig: Vertical and mounting of the left camera as it is mounted, without intrinsics.
        pair: The calibration.

    Raises:
        InputError: The rig says what only a depth image has.
    """
    if rig.depth_camera is not None or rig.depth_scale_m is not None or rig.depth_kind != "depth":
        raise InputError(
            "--depth-camera, --depth-scale or --depth-kind is given with --right: expected none of"
            " them, as the depth comes from the pictures"
        )
    rotation = pair.left_rotation
    up, mounting = rig.up_camera, rig.mounting
    if up is not None:
        x, y, z = (rotation @ unit_vector(up)).tolist()
        up = (x, y, z)
    if mounting is not None:
        mounting = calib.RigidTransform(mounting.rotation @ rotation.T, mounting.translation_m)
    return replace(rig, up_camera=up, mounting=mounting)


def open_stereo(
    left: Path, right: Path, pair: StereoPair, *, rig: Rig | None = None
) -> FrameSource:
    """Open two pictures, folders of pictures, or videos of a calibrated pair.

    Pictures of two folders belong together by their order; they must be as many. Pixels are those
    that the cameras stored.

    Args:
        left: Picture, folder or video of the left camera.
        right: The same of the right camera.
        pair: Their calibration, for pictures of any size of the same shape.
        rig: Correction of the depth.

    Returns:
        Frames of the rectified left picture with depth, its camera, and the depth's errors. A
        frame that cannot be read raises `InputError`, after which iteration goes on.

    Raises:
        InputError: A source is missing, or they have different numbers of pictures.
    """
    return _StereoFrames(left, right, pair, rig or Rig())


class _StereoFrames(BaseSource):
    def __init__(self, left: Path, right: Path, pair: StereoPair, rig: Rig) -> None:
        super().__init__(f"{left} and {right}")
        self._sides = [open_source(path, upright=False) for path in (left, right)]
        counts = [side.count for side in self._sides]
        first, second = counts
        if first is not None and second is not None and first != second:
            raise InputError(
                f"{left} has {counted(first, 'picture')} and {right} has {second}:"
                " expected as many, in the same order"
            )
        self.count = counts[0]
        self._pair, self._rig = pair, rig
        self._sized: dict[tuple[int, int], StereoPair] = {}

    def __iter__(self) -> Iterator[Frame]:
        left, right = (iter(side) for side in self._sides)
        wanted = iter(lambda: self._is_closed.is_set() or None, True)
        return map(lambda _, one, other: self._frame(one, other), wanted, left, right)

    def close(self) -> None:
        """End an iteration in progress."""
        super().close()
        for side in self._sides:
            side.close()

    def _frame(self, left: Frame, right: Frame) -> Frame:
        first, second = left.picture(), right.picture()
        if first.shape != second.shape:
            raise InputError(
                f"{right.where} is {second.shape[1]}x{second.shape[0]} px: expected"
                f" {first.shape[1]}x{first.shape[0]} px, like {left.where}"
            )
        return stereo_frame(left, second, self._of_size(first, left.where), self._rig)

    def _of_size(self, image: NDArray[np.uint8], where: str) -> StereoPair:
        size = (image.shape[1], image.shape[0])
        if size not in self._sized:
            try:
                self._sized[size] = self._pair.scaled(*size)
            except calib.CameraError as error:
                raise calib.CameraError(f"{where}: {error}") from error
        return self._sized[size]


def stereo_frame(left: Frame, right: NDArray[np.uint8], pair: StereoPair, rig: Rig) -> Frame:
    """A frame of the rectified left picture, with depth from both.

    Args:
        left: The frame of the left camera, as it is mounted.
        right: (H, W, 3) uint8 BGR of the right camera.
        pair: Their calibration, for this size.
        rig: Correction of the depth.
    """
    assert left.image is not None
    rectified = pair.rectified
    found = rectified.depth(left.image, right)
    depth_m = found.depth_m
    if rig.depth_calibration is not None:
        depth_m = rig.depth_calibration.apply(depth_m)
    fault = None
    if not (depth_m > 0).any():
        fault = (
            f"{left.where}: left and right picture do not match anywhere: expected two pictures of"
            " the same moment, left and right in their order, and their calibration"
        )
    up, pose = left.up_camera, left.pose
    if pose is not None:
        pose = calib.RigidTransform(pose.rotation @ rectified.rotation.T, pose.translation_m)
    return replace(
        left,
        image=found.image,
        depth_m=depth_m,
        depth_fault=fault,
        camera=rectified.camera,
        up_camera=None if up is None else rectified.rotation @ up,
        pose=pose,
        depth_noise=stereo_noise(found, rectified),
    )
