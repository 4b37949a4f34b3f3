"""Sources of frames: an image, a folder of images or a video, with optional depth images."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from basetree.files.names import DEPTH_SUFFIXES, IMAGE_SUFFIXES, VIDEO_SUFFIXES
from basetree.files.picture_size import check_picture_size
from basetree.files.reading import decode_image, is_image_file, open_video
from edgetree.frames.rig import Rig

__all__ = [
    "Frame",
    "FrameSource",
    "as_typed",
    "is_cut_off",
    "open_image_files",
    "open_source",
    "read_image",
]


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a source.

    Attributes:
        name: the file's stem, for videos with the frame's number; valid as a file name.
        path: the file of the frame.
        image: (H, W, 3) uint8 BGR; None if there is only depth.
        depth_m: (H, W) float32 metres along the optical axis, 0.0 = no reading, aligned with the
            image; None if there is no depth.
        depth_fault: why the depth is unusable; None if it is usable.
        time_s: position in the video; None for images.
    """

    name: str
    path: Path
    image: NDArray[np.uint8] | None
    depth_m: NDArray[np.float32] | None = None
    depth_fault: str | None = None
    time_s: float | None = None


class FrameSource(Protocol):
    """An iterable of frames."""

    @property
    def count(self) -> int | None:
        """Number of frames; None if it is not known in advance."""

    def __iter__(self) -> Iterator[Frame]: ...


def open_source(
    path: Path, depth: Path | None = None, *, depth_only: bool = False, rig: Rig | None = None
) -> FrameSource:
    """Open an image, a folder of images, or a video.

    Args:
        path: an image, a folder of images, or a video.
        depth: depth image of an image, or folder with a depth image of the same stem for each
            image of a folder.
        depth_only: whether `path` contains depth images instead of colour images.
        rig: cameras and depth unit. By default, depth is in millimetres and aligned with the image.

    Returns:
        The frames. Images are read during iteration, which may raise `InputError` or `InputError`
        for a frame and then go on with the next one.

    Raises:
        InputError: a file is missing or has another format.
    """
    rig = rig or Rig()
    if path.is_dir():
        return _FolderFrames(path, depth, depth_only, rig)
    if not path.exists():
        raise InputError(
            f"source {as_typed(path)} does not exist: expected an image, a folder or a video"
        )
    if path.suffix.lower() in IMAGE_SUFFIXES or is_image_file(path):
        if depth is not None and not depth.is_file():
            raise InputError(f"depth {depth} is not a file: expected the depth image of {path}")
        return _ImageFrames([(path.stem, path, depth)], depth_only, rig)
    if depth is not None or depth_only:
        raise InputError(
            f"source {path} is not an image: expected an image or a folder, as depth is used"
        )
    return _VideoFrames(path)


def open_image_files(
    files: Sequence[tuple[str, Path, Path | None]], *, depth_only: bool, rig: Rig
) -> FrameSource:
    """Open image files as frames.

    Args:
        files: (name of the frame, image, depth image or None) of each.
        depth_only: whether the images are depth images instead of colour images.
        rig: cameras and depth unit.

    Returns:
        The frames; iterating is as for `open_source`.
    """
    return _ImageFrames(files, depth_only, rig)


def as_typed(source: Path) -> str:
    """A source as the user typed it, for messages.

    `Path` reduces the two slashes of a URL such as rtsp://camera/1 to one.
    """
    return re.sub(r"^([A-Za-z][A-Za-z0-9+.-]+):/(?=[^/])", r"\1://", str(source))


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read a colour image, (H, W, 3) uint8 BGR. Greyscale images are converted to colour.

    Raises:
        InputError: the file is missing, not an image, truncated, or has more than 8 bits.
        InputFileError: it has more pixels than `limits.Limits.image_pixels`.
    """
    expected = "expected a complete 8-bit JPEG or PNG image, or another format that OpenCV reads"
    try:
        data = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise InputError(f"image {path} cannot be read ({error.strerror}): {expected}") from error
    check_picture_size(path)
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR
    image = None if is_cut_off(data) else decode_image(data, flags)
    if image is None:
        raise InputError(f"image {path} cannot be read ({data.size} bytes): {expected}")
    if image.dtype != np.uint8:
        raise InputError(
            f"image {path} is {image.dtype}: expected 8-bit colour; pass depth images with"
            " --depth, or use --model depth"
        )
    return np.asarray(image, dtype=np.uint8)


def is_cut_off(data: NDArray[np.uint8]) -> bool:
    """Whether a file is empty, or a PNG without its last chunk, which OpenCV reads in part."""
    content = data[:8].tobytes()
    return not content or (content.startswith(b"\x89PNG") and b"IEND" not in data[-64:].tobytes())


class _ImageFrames:
    """Image files: (name, image file, depth file or None) of each."""

    def __init__(
        self, files: Sequence[tuple[str, Path, Path | None]], depth_only: bool, rig: Rig
    ) -> None:
        self._files = files
        self._depth_only = depth_only
        self._rig = rig

    @property
    def count(self) -> int:
        return len(self._files)

    def __iter__(self) -> Iterator[Frame]:
        return map(self._read, self._files)  # which, unlike a generator, goes on after an error

    def _read(self, files: tuple[str, Path, Path | None]) -> Frame:
        name, path, depth = files
        if self._depth_only:
            return Frame(name, path, None, *self._rig.read_depth(depth or path))
        image = read_image(path)
        if depth is None:
            return Frame(name, path, image)
        size_px = (image.shape[1], image.shape[0])
        return Frame(name, path, image, *self._rig.read_depth(depth, path, size_px))


class _FolderFrames(_ImageFrames):
    """The images of a folder, sorted by name, with depth images of the same stems."""

    def __init__(self, folder: Path, depth: Path | None, depth_only: bool, rig: Rig) -> None:
        paths = sorted(
            path
            for path in folder.iterdir()
            if path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")
        )
        if not paths:
            raise InputError(f"folder {folder} has no images: expected {', '.join(IMAGE_SUFFIXES)}")
        counts = Counter(path.stem for path in paths)
        names = [path.stem if counts[path.stem] == 1 else path.name for path in paths]
        files = _depth_files(paths, depth)
        super().__init__(list(zip(names, paths, files, strict=True)), depth_only, rig)


def _depth_files(paths: list[Path], depth: Path | None) -> list[Path | None]:
    if depth is None:
        return [None] * len(paths)
    if not depth.is_dir():
        raise InputError(f"depth {depth} is not a folder: expected one, like {paths[0].parent}")
    return [_depth_file(path, depth) for path in paths]


def _depth_file(path: Path, depth: Path) -> Path:
    """The depth file with the image's stem."""
    files = [depth / f"{path.stem}{suffix}" for suffix in DEPTH_SUFFIXES]
    for file in files:
        if file.is_file():
            return file
    raise InputError(
        f"depth image {files[0]} does not exist, nor with {', '.join(DEPTH_SUFFIXES[1:])}: expected"
        f" one for image {path}"
    )


class _VideoFrames:
    """The frames of a video."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with closing(_Capture(path)) as capture:
            frames = int(capture.video.get(cv2.CAP_PROP_FRAME_COUNT))
            if not capture.video.grab():
                raise InputError(f"video {path} has no frame that OpenCV can read: expected one")
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
    """An open video."""

    def __init__(self, path: Path) -> None:
        self.video = open_video(path)
        # The suffix is checked too, because OpenCV opens even text files as videos.
        if path.suffix.lower() not in VIDEO_SUFFIXES or not self.video.isOpened():
            raise InputError(
                f"source {path} cannot be read: expected an image, a folder of images,"
                f" or a video ({', '.join(VIDEO_SUFFIXES)})"
            )

    def close(self) -> None:
        self.video.release()
