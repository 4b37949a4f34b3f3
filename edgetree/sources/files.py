"""Files as sources: an image, a folder of images or a video, with optional depth images."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from basetree.counts import counted
from basetree.errors import InputError
from basetree.files.headers.header import DepthNote
from basetree.files.names import DEPTH_SUFFIXES
from calib import CameraError
from calib.clouds import CLOUD_SUFFIXES, is_cloud_file
from edgetree.frames.frame import Frame
from edgetree.frames.images import read_colour, taken_words
from edgetree.frames.rig import Rig
from edgetree.sources.cloud_views import CloudViews
from edgetree.sources.depth_pairing import (
    frame_names,
)
from edgetree.sources.folders import ARRAY_SUFFIX, depth_alone, folder_files
from edgetree.sources.source import BaseSource, FrameSource, readable
from edgetree.sources.videos import VideoFrames, is_picture

_log = logging.getLogger(__name__)

# What `edgetree live` takes as a camera or an address.
_CAMERA: Final = re.compile(r"(?:realsense|oak|orbbec|\d+|/dev/video\d+)$|[a-z]+://")

_DEFAULT_RATE_HZ: Final = 15.0


def open_source(
    path: Path | str,
    depth: Path | str | None = None,
    *,
    depth_only: bool = False,
    rig: Rig | None = None,
    upright: bool = True,
) -> FrameSource:
    """Open an image, a folder of images, a video, or a point cloud as virtual cameras see it.

    A `.npy` file, a folder without pictures, and a source that is given as its own depth hold depth
    alone. With depth or a camera the pixels are those that the camera stored. Without both, they
    are turned as the EXIF orientation or the video says, as viewers show them. A warning tells
    which.

    Args:
        path: An image, a folder of images, or a video.
        depth: Depth image of an image, or folder with the depth images of a folder of images;
            `edgetree.sources.depth_pairing.depth_names` says which belong together. A frame whose
            depth image is missing raises `InputError`.
        depth_only: Whether `path` contains depth images instead of colour images.
        rig: Cameras and depth unit. By default, depth is in millimetres and aligned with the image.
        upright: Whether pictures without depth and camera are turned. False to find a camera's
            intrinsics, which are those of its stored pixels.

    Returns:
        The frames. Images are read during iteration, which may raise `InputError` for a frame and
        then go on with the next one.

    Raises:
        InputError: a file is missing or has another format.
    """
    path, depth = Path(path), None if depth is None else Path(depth)
    rig = rig or Rig()
    upright = upright and rig.camera is None
    alone = depth_alone(path, depth)
    if alone is not None:
        path, depth, depth_only = alone, None, True
    if path.is_dir():
        return _open_folder(path, depth, depth_only, rig, upright)
    if not path.exists():
        raise no_such_source(path)
    if is_cloud_file(path) and depth is None:
        return CloudViews(path, rig)
    if is_picture(path) or (depth_only and path.suffix.lower() == ARRAY_SUFFIX):
        if depth is not None and not depth.is_file():
            raise InputError(f"depth {depth} is not a file: expected the depth image of {path}")
        return ImageFrames(str(path), [(path.stem, path, depth)], depth_only, rig, upright)
    if depth is not None or depth_only:
        raise InputError(
            f"source {path} is not an image: expected an image or a folder, as depth is used; depth"
            " of a video comes from a recording, or from the video of a right camera (--right)"
        )
    return VideoFrames(path, upright)


def open_image_files(
    files: Sequence[tuple[str, Path, Path | None]],
    *,
    depth_only: bool,
    rig: Rig,
    upright: bool = True,
) -> FrameSource:
    """Open image files as frames.

    Args:
        files: (name of the frame, image, depth image or None) of each.
        depth_only: Whether the images are depth images instead of colour images.
        rig: Cameras and depth unit.
        upright: As for `open_source`.

    Returns:
        The frames; iterating is as for `open_source`.
    """
    upright = upright and rig.camera is None
    return ImageFrames(counted(len(files), "image"), files, depth_only, rig, upright)


def open_files(
    path: Path,
    depth: Path | None = None,
    *,
    depth_only: bool = False,
    rig: Rig | None = None,
    rate_hz: float = _DEFAULT_RATE_HZ,
) -> FrameSource:
    """Open an image, a folder of images or a video as a stream: its frames have numbers and times.

    Images that cannot be read are left out.

    Args:
        path: An image, a folder of images, or a video.
        depth: Depth image or folder of depth images, as for `open_source`.
        depth_only: Whether `path` contains depth images instead of colour images.
        rig: The cameras and the unit of the depth.
        rate_hz: Frames per second of images, which have no time stamps.

    Raises:
        InputError: a file is missing or has another format, or the rate is not above 0.
    """
    rig = rig or Rig()
    return as_stream(open_source(path, depth, depth_only=depth_only, rig=rig), rig, rate_hz)


def as_stream(
    frames: FrameSource, rig: Rig | None = None, rate_hz: float = _DEFAULT_RATE_HZ
) -> FrameSource:
    """Frames of files as a stream: with numbers, times, and what the rig states.

    Args:
        frames: Frames of pictures or a video. Those that cannot be read are left out.
        rig: Camera, vertical and mounting of frames that have none.
        rate_hz: Frames per second of images, which have no time stamps.

    Raises:
        InputError: The rate is not above 0.
    """
    if not (math.isfinite(rate_hz) and rate_hz > 0):
        raise InputError(f"rate_hz is {rate_hz}: expected frames per second, above 0")
    return _Stream(frames, rig or Rig(), rate_hz)


def no_such_source(path: Path) -> InputError:
    """The error for a source that is not there; that of a camera says which command takes it."""
    typed = as_typed(path)
    fault = f"source {typed} does not exist: expected an image, a folder or a video"
    is_camera = _CAMERA.match(typed) is not None
    return InputError(fault + f"; a camera or a stream is for `edgetree live {typed}`" * is_camera)


def as_typed(source: Path) -> str:
    """A source as the user typed it, for messages.

    `Path` reduces the two slashes of a URL such as rtsp://camera/1 to one.
    """
    return re.sub(r"^([A-Za-z][A-Za-z0-9+.-]+):/(?=[^/])", r"\1://", str(source))


def _open_folder(
    folder: Path, depth: Path | None, depth_only: bool, rig: Rig, upright: bool
) -> FrameSource:
    """The images of a folder, in the order of their numbers or names, with their depth images."""
    files = folder_files(folder, depth, depth_only=depth_only)
    names = frame_names([path for path, _ in files])
    named = [(name, *file) for name, file in zip(names, files, strict=True)]
    is_depth = depth_only and not any(depth for _, depth in files)
    return ImageFrames(str(folder), named, is_depth, rig, upright)


class ImageFrames(BaseSource):
    """Image files: (name, image file, depth file or None) of each.

    Attributes:
        names: The names of the frames, in their order.
    """

    def __init__(
        self,
        name: str,
        files: Sequence[tuple[str, Path, Path | None]],
        depth_only: bool,
        rig: Rig,
        upright: bool,
    ) -> None:
        super().__init__(name)
        self.count, self.names = len(files), [name for name, _, _ in files]
        self._files, self._depth_only, self._rig = files, depth_only, rig
        self._upright, self._has_told, self._told_depth = upright, False, False

    def __iter__(self) -> Iterator[Frame]:
        wanted = takewhile(lambda _: not self._is_closed.is_set(), self._files)
        return map(self._read, wanted)  # which, unlike a generator, goes on after an error

    def _read(self, files: tuple[str, Path, Path | None]) -> Frame:
        name, path, depth = files
        if self._depth_only:
            return Frame(name, path, None, *self._rig.read_depth(depth or path))
        if depth is not None and not depth.is_file():
            is_cloud = is_cloud_file(depth)
            kind, suffixes = "cloud" if is_cloud else "depth image", list(DEPTH_SUFFIXES)
            if is_cloud:
                suffixes = list(CLOUD_SUFFIXES)
            others = ", ".join(suffix for suffix in suffixes if suffix != depth.suffix.lower())
            raise InputError(
                f"{kind} {depth} does not exist, nor with {others}: expected one for image {path}"
            )
        image, focal_px = self._pixels(path, depth)
        if depth is None:
            return Frame(name, path, image, exif_focal_px=focal_px)
        size_px = (image.shape[1], image.shape[0])
        if is_cloud_file(depth):
            beams = self._rig.read_beams(depth, size_px)
            return Frame(name, path, image, beams.depth_m, filled_depth_m=beams.filled_m)
        return Frame(name, path, image, *self._rig.read_depth(depth, path, size_px))

    def _pixels(self, path: Path, depth: Path | None) -> tuple[NDArray[np.uint8], float | None]:
        """Read an image and its focal length; the first one that states an orientation is told."""
        picture, upright = read_colour(path), self._upright and depth is None
        if picture.orientation != 1 and not self._has_told:
            self._has_told = True
            _log.warning("%s: %s", path, taken_words(picture.orientation, upright))
        if picture.depth is not None and depth in (None, path) and not self._told_depth:
            self._told_depth = True
            _log.warning(
                "%s",
                _depth_words(
                    path, picture.depth, is_taken=depth is not None and picture.depth.is_metric
                ),
            )
        pixels = np.asarray(picture.upright() if upright else picture.pixels, np.uint8)
        return pixels, picture.focal_px


def _depth_words(path: Path, depth: DepthNote, *, is_taken: bool) -> str:
    """What is told of a depth image in a picture's file."""
    if is_taken:
        return (
            f"depth of {path} is its own image {depth.words}; nothing says how far its scale is"
            " off: --rig-errors scale=SHARE does"
        )
    if depth.is_metric:
        return f"{path} holds a depth image {depth.words}: --depth {path} takes it"
    return (
        f"{path} holds a depth image {depth.words}, so it is not used: record with Record3D or"
        " Stray Scanner for metres"
    )


class _Stream(BaseSource):
    """Files whose frames have numbers, times and the camera and vertical of a rig."""

    def __init__(self, files: FrameSource, rig: Rig, rate_hz: float) -> None:
        super().__init__(files.name)
        self.count = files.count
        self.counts = files.counts  # type: ignore[assignment]
        self._frames, self._rig, self._rate_hz = files, rig, rate_hz

    def __iter__(self) -> Iterator[Frame]:
        earlier = self.counts["unreadable images"]
        for number, frame in enumerate(readable(self._frames, self._leave_out)):
            if self._is_closed.is_set():
                return
            # The frames that were left out have numbers and times too.
            yield self._numbered(number + self.counts["unreadable images"] - earlier, frame)

    def _leave_out(self, error: Exception) -> None:
        self.counts["unreadable images"] += 1
        _log.warning("%s", error)

    def _numbered(self, number: int, frame: Frame) -> Frame:
        picture = frame.depth_m if frame.image is None else frame.image
        assert picture is not None
        try:
            frame = self._rig.completed(frame, picture.shape[1], picture.shape[0])
        except CameraError as error:
            raise CameraError(f"{frame.where}: {error}") from error
        time_s = number / self._rate_hz if frame.time_s is None else frame.time_s
        return replace(frame, number=number, time_s=time_s)
