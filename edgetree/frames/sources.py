"""Where frames come from: an image, a folder of images, or a video; depth images beside them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from edgetree.errors import InputError
from edgetree.frames.rig import Rig

__all__ = [
    "DEPTH_SUFFIXES",
    "IMAGE_SUFFIXES",
    "VIDEO_SUFFIXES",
    "Frame",
    "FrameSource",
    "is_cut_off",
    "open_source",
    "read_image",
]

IMAGE_SUFFIXES: Final = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
DEPTH_SUFFIXES: Final = (".png", ".tif", ".tiff", ".npy")
VIDEO_SUFFIXES: Final = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv")


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture of a source.

    Attributes:
        name: the file's stem, or a video's with the frame's number; good as a file name.
        path: the file it comes from.
        image: (H, W, 3) uint8 BGR; None if the source is depth alone.
        depth_m: (H, W) float32 metres along the optical axis, 0.0 = no reading, in the image's
            pixels; None without depth.
        depth_fault: why that depth is not to be believed; None if it may be.
        time_s: position in a video, else None.
    """

    name: str
    path: Path
    image: NDArray[np.uint8] | None
    depth_m: NDArray[np.float32] | None = None
    depth_fault: str | None = None
    time_s: float | None = None


class FrameSource(Protocol):
    """Frames, one after the other."""

    @property
    def count(self) -> int | None:
        """Number of frames, None if it is not known before the end."""

    def __iter__(self) -> Iterator[Frame]: ...


def open_source(
    path: Path, depth: Path | None = None, *, depth_only: bool = False, rig: Rig | None = None
) -> FrameSource:
    """Find out what `path` is.

    Args:
        path: an image, a folder of images, or a video.
        depth: for an image its depth image, for a folder a folder of depth images with the same
            stems.
        depth_only: `path` itself holds such depth images, and no others.
        rig: what took them, and the unit of the depth; without, it is millimetres in the image's
            own pixels.

    Raises:
        InputError: a file is missing or of another kind. Images are read when their turn comes.
    """
    rig = rig or Rig()
    if path.is_dir():
        return _FolderFrames(path, depth, depth_only, rig)
    if not path.exists():
        raise InputError(f"source {path} is not there: expected an image, a folder or a video")
    if path.suffix.lower() in IMAGE_SUFFIXES or cv2.haveImageReader(str(path)):
        if depth is not None and not depth.is_file():
            raise InputError(f"depth {depth} is no file: expected the depth image of {path}")
        return _ImageFrames([(path.stem, path, depth)], depth_only, rig)
    if depth is not None or depth_only:
        raise InputError(f"source {path} is no image: expected an image or a folder, to have depth")
    return _VideoFrames(path)


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read a colour image, (H, W, 3) uint8 BGR; grey ones become colour.

    Raises:
        InputError: the file is missing, no image, cut off, or has more than 8 bits.
    """
    expected = "expected a whole 8-bit JPEG or PNG image, or another that OpenCV reads"
    try:
        data = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise InputError(f"image {path} cannot be read ({error.strerror}): {expected}") from error
    image = None if is_cut_off(data) else cv2.imdecode(data, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"image {path} cannot be read ({data.size} bytes): {expected}")
    if image.dtype != np.uint8:
        raise InputError(
            f"image {path} holds {image.dtype}: expected 8-bit colour;"
            " depth images go to --depth, or alone with --model depth"
        )
    return np.asarray(image, dtype=np.uint8)


def is_cut_off(data: NDArray[np.uint8]) -> bool:
    """Whether the file is empty, or a PNG without its end, of which OpenCV would make half."""
    content = data[:8].tobytes()
    return not content or (content.startswith(b"\x89PNG") and b"IEND" not in data[-64:].tobytes())


class _ImageFrames:
    """Image files, each with its name and, maybe, its depth image."""

    def __init__(
        self, files: list[tuple[str, Path, Path | None]], depth_only: bool, rig: Rig
    ) -> None:
        self._files = files
        self._depth_only = depth_only
        self._rig = rig

    @property
    def count(self) -> int:
        return len(self._files)

    def __iter__(self) -> Iterator[Frame]:
        for name, path, depth in self._files:
            if self._depth_only:
                yield Frame(name, path, None, *self._rig.read_depth(depth or path))
                continue
            image = read_image(path)
            if depth is None:
                yield Frame(name, path, image)
                continue
            size_px = (image.shape[1], image.shape[0])
            yield Frame(name, path, image, *self._rig.read_depth(depth, path, size_px))


class _FolderFrames(_ImageFrames):
    """The images of a folder by name, with those of the same stem in a depth folder."""

    def __init__(self, folder: Path, depth: Path | None, depth_only: bool, rig: Rig) -> None:
        paths = sorted(
            path
            for path in folder.iterdir()
            if path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")
        )
        if not paths:
            raise InputError(f"folder {folder} has no images: expected {', '.join(IMAGE_SUFFIXES)}")
        for path in paths:
            if not cv2.haveImageReader(str(path)):
                raise InputError(
                    f"image {path} cannot be read: expected an image that OpenCV reads"
                )
        stems = [path.stem for path in paths]
        names = [path.stem if stems.count(path.stem) == 1 else path.name for path in paths]
        mates = _depth_mates(paths, depth)
        super().__init__(list(zip(names, paths, mates, strict=True)), depth_only, rig)


def _depth_mates(paths: list[Path], depth: Path | None) -> list[Path | None]:
    if depth is None:
        return [None] * len(paths)
    if not depth.is_dir():
        raise InputError(f"depth {depth} is no folder: expected one, as for {paths[0].parent}")
    return [_depth_mate(path, depth) for path in paths]


def _depth_mate(path: Path, depth: Path) -> Path:
    """The depth file of an image's stem."""
    mates = [depth / f"{path.stem}{suffix}" for suffix in DEPTH_SUFFIXES]
    for mate in mates:
        if mate.is_file():
            return mate
    raise InputError(
        f"depth image {mates[0]} is not there, nor with {', '.join(DEPTH_SUFFIXES[1:])}: expected"
        f" one for image {path}"
    )


class _VideoFrames:
    """The frames of a video."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with closing(_Capture(path)) as capture:
            frames = int(capture.video.get(cv2.CAP_PROP_FRAME_COUNT))
            if not capture.video.grab():
                raise InputError(f"video {path} has no frame that OpenCV can read: expected some")
        self.count = frames if frames > 0 else None

    def __iter__(self) -> Iterator[Frame]:
        with closing(_Capture(self._path)) as capture:
            number = 0
            while True:
                found, image = capture.video.read()
                if not found:
                    return
                time_s = capture.video.get(cv2.CAP_PROP_POS_MSEC) / 1000
                name = f"{self._path.stem}_{number:06d}"
                pixels = np.asarray(image, dtype=np.uint8)
                yield Frame(name, self._path, pixels, time_s=round(time_s, 3))
                number += 1


class _Capture:
    """An open video, closed when done."""

    def __init__(self, path: Path) -> None:
        self.video = cv2.VideoCapture(str(path))
        # By name too, as OpenCV is glad to play a text file.
        if path.suffix.lower() not in VIDEO_SUFFIXES or not self.video.isOpened():
            raise InputError(
                f"source {path} cannot be read: expected an image, a folder of images,"
                f" or a video ({', '.join(VIDEO_SUFFIXES)})"
            )

    def close(self) -> None:
        self.video.release()
