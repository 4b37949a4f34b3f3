"""Captures of Stray Scanner: a folder with a video, depth, confidence, camera and odometry.

    rgb.mp4                colour as the sensor stores it, lying on its side if the phone is upright
    depth/000000.png       16 bits in millimetres, 256 x 192 px (.npy in older versions)
    confidence/000000.png  0, 1 or 2
    camera_matrix.csv      three rows of the camera matrix of the pictures
    odometry.csv           timestamp, frame, x, y, z, qx, qy, qz, qw; older ones have no header

Poses are from the camera's axes (x right, y down, z forward) to ARKit's world with y up. The
accelerations of imu.csv are not needed, as ARKit's world follows gravity.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

import calib
from basetree.errors import InputError
from basetree.files.reading import read_picture, read_text
from calib.depth.files import read_values
from calib.files import load_camera
from calib.sizeless import SizelessCamera
from edgetree.frames.rig import Rig
from edgetree.sources.phones.capture import (
    MOST_FRAMES,
    Capture,
    PhoneFrame,
    stored_pose,
    with_z_up,
)
from edgetree.sources.videos import VideoFrames

VIDEO: Final = "rgb.mp4"
CAMERA: Final = "camera_matrix.csv"
ODOMETRY: Final = "odometry.csv"
_LARGEST_TABLE_BYTES: Final = 2**27
_POSE: Final = ("x", "y", "z", "qx", "qy", "qz", "qw")
_LOST: Final = 0.25  # a step that is longer than the odometry's by a period less this


def is_stray(folder: Path) -> bool:
    """Whether a folder is a capture of Stray Scanner."""
    return all((folder / name).exists() for name in (VIDEO, CAMERA, "depth"))


def open_stray(folder: Path, *, rig: Rig | None = None) -> Capture:
    """Open a capture of Stray Scanner.

    Args:
        folder: Its folder.
        rig: Cameras that take the place of the capture's, and the correction of the depth.

    Returns:
        Its frames, with colour, depth, camera, time, pose and gravity. Frames that cannot be read
        or have no depth are left out.

    Raises:
        InputError: A file is missing or cannot be read.
    """
    return _Stray(folder, rig or Rig())


class _Stray(Capture):
    def __init__(self, folder: Path, rig: Rig) -> None:
        self._depths = _numbered(folder / "depth")
        super().__init__(folder, rig, len(self._depths))
        self._confidences = _numbered(folder / "confidence")
        self._camera = load_camera(folder / CAMERA)
        self._poses = read_odometry(folder / ODOMETRY)
        # The depth is in the pixels that the sensor stores.
        self._video = VideoFrames(folder / VIDEO, upright=False)

    def close(self) -> None:
        """End an iteration in progress."""
        super().close()
        self._video.close()

    def _stored(self) -> Iterator[PhoneFrame | InputError]:
        with closing(iter(self._video)) as pictures:  # type: ignore[type-var]
            number, before_s = -1, 0.0
            for picture in pictures:
                number, time_s = number + 1, picture.time_s or 0.0
                number, before_s = number + self._lost(number, time_s - before_s), time_s
                if number not in self._depths:
                    self.counts["colour without depth"] += 1
                    continue
                assert picture.image is not None
                try:
                    yield self._one(number, picture.image, time_s)
                except InputError as error:
                    yield error
        self.counts.update(self._video.counts)

    def _lost(self, number: int, step_s: float) -> int:
        """How many pictures the video lacks before one, as it is damaged.

        Args:
            number: Number of the picture if none is lost.
            step_s: Time in the video since the picture before, s.
        """
        before, now = (self._poses.get(each, (None,))[0] for each in (number - 1, number))
        if before is None or now is None:
            return 0
        return max(0, int((step_s - (now - before)) * self._video.rate_hz + _LOST))

    def _one(self, number: int, image: NDArray[np.uint8], time_s: float) -> PhoneFrame:
        found = self._poses.get(number)
        confidence = self._confidences.get(number)
        camera = self._camera
        if isinstance(camera, SizelessCamera):
            camera = camera.scaled(image.shape[1], image.shape[0])
        return PhoneFrame(
            f"{self._path.name}_{number:06d}",
            image,
            read_values(self._depths[number]),
            None if confidence is None else read_confidence(confidence),
            camera,
            time_s if found is None or found[0] is None else found[0],
            None if found is None else found[1],
            found is not None,
        )


def _numbered(folder: Path) -> dict[int, Path]:
    """The files of a folder by the number that is their name; empty if it is not there."""
    if not folder.is_dir():
        return {}
    files = [path for path in folder.iterdir() if path.suffix.lower() in (".png", ".npy")]
    return {int(path.stem): path for path in files if path.stem.isascii() and path.stem.isdecimal()}


def read_confidence(path: Path) -> NDArray[np.uint8]:
    """Read a confidence map, (h, w) 0 to 2; InputError if it is none."""
    picture = read_picture(path, cv2.IMREAD_UNCHANGED)
    if picture is None or picture.pixels.ndim != 2 or picture.pixels.dtype != np.uint8:
        raise InputError(f"confidence {path} cannot be read: expected a PNG of 8 bits, 0 to 2")
    return np.asarray(picture.pixels, np.uint8)


_TimedPose = tuple[float | None, calib.RigidTransform]


def read_odometry(path: Path) -> dict[int, _TimedPose]:
    """Read time and pose of each frame by its number; empty if the file is not there.

    Raises:
        InputError: The file cannot be read, or a row is no pose.
    """
    if not path.exists():
        return {}
    expected = "the odometry of Stray Scanner"
    try:
        rows = list(csv.reader(read_text(path, expected, _LARGEST_TABLE_BYTES).splitlines()))
    except csv.Error as error:
        raise InputError(f"{path} cannot be read ({error}): expected {expected}") from error
    rows = [[cell.strip() for cell in row] for row in rows if row]
    names = list(_POSE)
    if rows and not _is_number(rows[0][0]):
        names, rows = rows[0], rows[1:]
    missing = [name for name in _POSE if name not in names]
    if missing:
        raise InputError(f"{path} has no column {missing[0]}: expected {', '.join(_POSE)}")
    if len(rows) > MOST_FRAMES:
        raise InputError(f"{path} has {len(rows)} rows: expected at most {MOST_FRAMES}")
    found: dict[int, _TimedPose] = {}
    for index, row in enumerate(rows):
        where = f"{path}, row {index + 1}"
        values = _row_values(dict(zip(names, row, strict=False)), where)
        try:
            pose = with_z_up(stored_pose(values[3:7], values[:3]))
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
        found[int(values[7]) if math.isfinite(values[7]) else index] = (
            values[8] if math.isfinite(values[8]) else None,
            pose,
        )
    return found


def _row_values(row: dict[str, str], where: str) -> list[float]:
    """The numbers of a pose, then those of frame and timestamp, NaN where there is none."""
    texts = [row.get(name, "") for name in _POSE]
    if not all(map(_is_number, texts)):
        raise InputError(f"{where} has {', '.join(texts)}: expected seven numbers of a pose")
    more = [row.get(name, "") for name in ("frame", "timestamp")]
    return [float(text) if _is_number(text) else math.nan for text in (*texts, *more)]


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text)) and abs(float(text)) < 1e12
    except ValueError:
        return False
