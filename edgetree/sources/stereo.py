"""Stereo pairs as sources: two pictures, folders, videos or topics, with their calibration."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
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
from edgetree.sources.bags.pairing import StampCheck
from edgetree.sources.bags.recording import open_recording
from edgetree.sources.files import ImageFrames, open_source
from edgetree.sources.source import BaseSource, FrameSource
from edgetree.sources.videos import VideoFrames

_log = logging.getLogger(__name__)

_BIAS_PX: Final = 0.03
"""Disparity error that all readings on one stem share, px: what is left of the pull to whole
pixels. Source: chosen, the largest on shifted pictures of a known shift."""

_CORRELATION_PX: Final = 8.0
"""Readings nearer than this share their error. Source: bound, the blocks have 7 px."""

_LEAST_MATCHED: Final = 0.03
"""Pictures that match at a smaller share of their pixels are told. Source: chosen by hand; pairs
match at a third of their pixels and more, swapped ones at up to 2.6 %."""

_LEAST_NOISE_M: Final = 0.001
_DEFAULT_PERIOD_NS: Final = 1_000_000_000 // 30

_LOST: Final = 0.75
"""From this share of a period on, a step of one video beyond that of the other is a lost picture.
Source: chosen; pictures are shown up to half a period late, and a lost one leaves a whole one."""

_EXPECTED_PAIR: Final = (
    "expected two pictures of the same moment, left and right in their order, and their calibration"
)

RIGHT_TOPIC: Final = "right"
"""The role of the right camera's topic in a recording."""


@lru_cache(maxsize=64)
def _tell_few_matches(pictures: str) -> None:
    """Say it once for the pictures of a folder, a video or a recording."""
    _log.warning(
        "%s: left and right pictures match at less than %g %% of their pixels, as dark or foggy"
        " ones do: %s",
        *(pictures, 100 * _LEAST_MATCHED, _EXPECTED_PAIR),
        extra={"is_remark": True},
    )


def _pictures_of(frame: Frame) -> str:
    """The folder, video or recording of a frame."""
    if frame.path is None:
        return "the cameras"
    return str(frame.path.parent if frame.number is None else frame.path)


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
    left: Path | str, right: Path | str, pair: StereoPair, *, rig: Rig | None = None
) -> FrameSource:
    """Open two pictures, folders of pictures, or videos of a calibrated pair.

    Pictures of two folders belong together by their order; they must be as many, and have the same
    names if they share any. Those of videos do, too, but for pictures that one of them lacks by its
    time stamps. Pixels are those that the cameras stored.

    Args:
        left: Picture, folder or video of the left camera.
        right: The same of the right camera.
        pair: Their calibration, for pictures of any size of the same shape.
        rig: Correction of the depth.

    Returns:
        Frames of the rectified left picture with depth, its camera, and the depth's errors. A
        frame that cannot be read raises `InputError`, after which iteration goes on.

    Raises:
        InputError: A source is missing, or they have different numbers of pictures, or share some
            of their names.
    """
    sides = [open_source(path, upright=False) for path in (left, right)]
    first, second = (side.count for side in sides)
    if first is not None and second is not None and first != second:
        raise InputError(
            f"{left} has {counted(first, 'picture')} and {right} has {second}:"
            " expected as many, in the same order"
        )
    name = f"{left} and {right}"
    videos = [side for side in sides if isinstance(side, VideoFrames)]
    if len(videos) == len(sides):
        return _StereoVideos(name, videos, pair, rig or Rig())
    _check_names(name, sides)
    return _StereoFrames(name, sides, pair, rig or Rig())


def _check_names(name: str, sides: list[FrameSource]) -> None:
    """Raise InputError if pictures of the two sides share names, but not all of them."""
    left, right = (side.names if isinstance(side, ImageFrames) else [] for side in sides)
    if not set(left) & set(right):
        return
    for one, other in zip(left, right, strict=False):
        if one != other:
            raise InputError(
                f"{name} have other names in their order, {one} of the left beside {other} of the"
                " right: expected the same names, as each lacks pictures that the other has"
            )


def open_stereo_recording(
    path: Path, pair: StereoPair, *, topics: Mapping[str, str], rig: Rig | None = None
) -> FrameSource:
    """Open the two cameras of a recording.

    Pictures belong together if their time stamps differ by at most half a period.

    Args:
        path: As for `open_recording`.
        pair: Their calibration.
        topics: Names of topics by role, as for `open_recording`: `right` is that of the right
            camera's pictures and `colour` that of the left one's.
        rig: Correction of the depth.

    Returns:
        Frames as of `open_stereo`, with the times, verticals and poses of the recording.

    Raises:
        InputError: As for `open_recording`.
        MissingPackage: Rosbags is not installed.
    """
    of_left = {role: name for role, name in topics.items() if role != RIGHT_TOPIC}
    of_right = {"colour": topics[RIGHT_TOPIC]}
    sides = [open_recording(path, topics=each, modality="rgb") for each in (of_left, of_right)]
    return _StereoRecording(str(path), sides, pair, rig or Rig())


class _InStep:
    """The pictures of two sides in turn; one that cannot be read leaves out its whole pair."""

    def __init__(self, left: Iterator[Frame], right: Iterator[Frame]) -> None:
        self._left, self._right = left, right

    def __iter__(self) -> Iterator[tuple[Frame, Frame]]:
        return self

    def __next__(self) -> tuple[Frame, Frame]:
        left, right = _next_or_error(self._left), _next_or_error(self._right)
        for side in (left, right):
            if isinstance(side, InputError):
                raise side
        assert isinstance(left, Frame)
        assert isinstance(right, Frame)
        return left, right


def _next_or_error(frames: Iterator[Frame]) -> Frame | InputError:
    try:
        return next(frames)
    except InputError as error:
        return error


class _StereoFrames(BaseSource):
    def __init__(self, name: str, sides: list[FrameSource], pair: StereoPair, rig: Rig) -> None:
        super().__init__(name)
        self._sides = sides
        self.count = sides[0].count
        self._pair, self._rig = pair, rig
        self._sized: dict[tuple[int, int], StereoPair] = {}

    def __iter__(self) -> Iterator[Frame]:
        left, right = (iter(side) for side in self._sides)
        wanted = iter(lambda: self._is_closed.is_set() or None, True)
        return map(lambda _, pair: self._frame(*pair), wanted, self._pairs(left, right))

    def _pairs(
        self, left: Iterator[Frame], right: Iterator[Frame]
    ) -> Iterable[tuple[Frame, Frame]]:
        return _InStep(left, right)

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


class _StereoVideos(_StereoFrames):
    """The frames of two videos, which stay in step behind a picture that one of them lacks."""

    def __init__(self, name: str, sides: list[VideoFrames], pair: StereoPair, rig: Rig) -> None:
        super().__init__(name, [*sides], pair, rig)
        self._lost_s = _LOST / max(side.rate_hz for side in sides)

    def _pairs(
        self, left: Iterator[Frame], right: Iterator[Frame]
    ) -> Iterable[tuple[Frame, Frame]]:
        try:
            yield from self._in_step(left, right)
        finally:
            self.counts |= Counter(self._sides[0].counts) + Counter(self._sides[1].counts)

    def _in_step(
        self, left: Iterator[Frame], right: Iterator[Frame]
    ) -> Iterator[tuple[Frame, Frame]]:
        apart_s = None
        one, other = next(left, None), next(right, None)
        while one is not None and other is not None:
            now_s = one.stamp_s - other.stamp_s
            apart_s = now_s if apart_s is None else apart_s
            if abs(now_s - apart_s) < self._lost_s:
                apart_s = now_s  # the two clocks may drift
                yield one, other
                one, other = next(left, None), next(right, None)
            elif now_s < apart_s:
                self.counts["left pictures without a right one"] += 1
                one = next(left, None)
            else:
                self.counts["right pictures without a left one"] += 1
                other = next(right, None)


class _StereoRecording(_StereoFrames):
    """The frames of two topics, which belong together by their time stamps."""

    def _pairs(
        self, left: Iterator[Frame], right: Iterator[Frame]
    ) -> Iterable[tuple[Frame, Frame]]:
        try:
            yield from self._of_one_moment(left, right)
        finally:
            for side in self._sides:  # both read the same file
                self.counts |= Counter(side.counts)

    def _of_one_moment(
        self, left: Iterator[Frame], right: Iterator[Frame]
    ) -> Iterator[tuple[Frame, Frame]]:
        checks, sides, is_empty = (StampCheck(), StampCheck()), (left, right), True

        def following(number: int) -> Frame | None:
            frame = next(sides[number], None)
            if frame is not None:
                checks[number].see(_stamp_ns(frame))
            return frame

        one, other = following(0), following(1)
        while one is not None and other is not None:
            ahead_ns = _stamp_ns(one) - _stamp_ns(other)
            periods = [check.period_ns or _DEFAULT_PERIOD_NS for check in checks]
            if abs(ahead_ns) <= min(periods) // 2:
                is_empty = False
                yield one, other
                one, other = following(0), following(1)
            elif ahead_ns < 0:
                self.counts["left pictures without a right one"] += 1
                one = following(0)
            else:
                self.counts["right pictures without a left one"] += 1
                other = following(1)
        if is_empty and not self._is_closed.is_set():
            raise InputError(
                f"{self.name}: no left and right picture are of the same moment: expected time"
                " stamps that differ by at most half a period"
            )


def _stamp_ns(frame: Frame) -> int:
    assert frame.time_s is not None
    return round(frame.time_s * 1e9)


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
    fault, matched = None, np.count_nonzero(depth_m > 0) / depth_m.size
    if not matched:
        fault = f"{left.where}: left and right picture match nowhere: {_EXPECTED_PAIR}"
    elif matched < _LEAST_MATCHED:
        _tell_few_matches(_pictures_of(left))
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
