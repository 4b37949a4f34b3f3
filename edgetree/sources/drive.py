"""Drives of the simulator, with time, pose and gravity of every frame."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

import calib
from basetree.errors import InputError
from basetree.files.json import decode
from basetree.files.names import is_inside
from basetree.files.regular import open_regular
from edgetree.frames.frame import Frame
from edgetree.frames.images import read_image
from edgetree.frames.rig import Rig, unit_vector
from edgetree.sources.source import BaseSource, FrameSource

_log = logging.getLogger(__name__)

_LABELS: Final = ("train_RGB.json", "val_RGB.json", "test_RGB.json")
_LARGEST_LABELS_BYTES: Final = 2**28  # a frame with its trees has about 10,000

_Three = tuple[float, float, float]


@dataclass(frozen=True)
class _Pose:
    """The camera in the world: its position, and its axes in the rows of the rotation."""

    origin_m: _Three
    rotation: tuple[_Three, _Three, _Three]


@dataclass(frozen=True)
class _Image:
    """The label of one frame."""

    file_name: str
    depth_file: str
    imu_file: str
    time_s: float
    camera: dict[str, Any]
    up_camera: _Three
    pose_world: _Pose

    @property
    def scene(self) -> int:
        """Number of the drive, which its file of the IMU has as name."""
        return int(Path(self.imu_file).stem)

    def __post_init__(self) -> None:
        name = Path(self.imu_file).stem
        if not (name.isascii() and name.isdigit() and len(name) < 10):
            raise ValueError(f"imu_file is {self.imu_file!r:.60}, expected a number as its name")


@dataclass(frozen=True)
class _Labels:
    """The labels of a dataset, as far as drives need them."""

    images: tuple[_Image, ...]


def is_drive(folder: Path) -> bool:
    """Whether a folder is a dataset of the simulator's preset `drive`."""
    return (folder / "imu").is_dir() and any((folder / name).is_file() for name in _LABELS)


def open_drive(folder: Path, *, scene: int | None = None, rig: Rig | None = None) -> FrameSource:
    """Open a drive of a dataset that `perceptree synth --preset drive` wrote.

    Args:
        folder: Folder of the dataset.
        scene: Number of the drive; None if the dataset has only one.
        rig: Unit, kind and correction of the depth; millimetres by default.

    Returns:
        Its frames in the order of time, with the exact pose, gravity and camera. Frames whose
        images cannot be read are left out.

    Raises:
        InputError: The folder is no such dataset, or it is not clear which drive is meant.
    """
    return _Drive(folder, scene, rig or Rig())


class _Drive(BaseSource):
    """The frames of one drive."""

    def __init__(self, folder: Path, scene: int | None, rig: Rig) -> None:
        self._folder, self._rig = folder, rig
        drives = _drives(folder)
        listed = ", ".join(str(number) for number in sorted(drives))
        if scene is None and len(drives) > 1:
            raise InputError(
                f"dataset {folder} has {len(drives)} drives: expected one of the scenes {listed}"
            )
        number = next(iter(drives)) if scene is None else scene
        if number not in drives:
            raise InputError(f"dataset {folder} has no scene {number}: expected one of {listed}")
        super().__init__(f"{folder}, scene {number}")
        for image in drives[number]:
            for name in (image.file_name, image.depth_file):
                _check_inside(folder, name)
        self._images = sorted(drives[number], key=lambda image: image.time_s)
        self.count = len(self._images)

    def __iter__(self) -> Iterator[Frame]:
        for number, image in enumerate(self._images):
            if self._is_closed.is_set():
                return
            try:
                yield self._frame(number, image)
            except InputError as error:
                self.counts["unreadable images"] += 1
                _log.warning("%s", error)

    def _frame(self, number: int, image: _Image) -> Frame:
        path, depth = self._folder / image.file_name, self._folder / image.depth_file
        camera = calib.PinholeCamera.from_dict(image.camera)
        given = self._rig.camera_for(camera.width, camera.height)
        rig = replace(self._rig, camera=given or camera, depth_camera=None, depth_extrinsics=None)
        depth_m, fault = rig.read_depth(depth)
        pose = image.pose_world
        return Frame(
            path.stem,
            path,
            read_image(path),
            depth_m,
            fault,
            image.time_s,
            number,
            camera,
            unit_vector(image.up_camera),
            # The rows of the label's rotation are the camera's axes in the world.
            calib.RigidTransform(np.transpose(pose.rotation), np.array(pose.origin_m)),
        )


def _check_inside(folder: Path, name: str) -> None:
    """Raise InputError if the labels name a file that is not in the dataset."""
    if not is_inside(name):
        raise InputError(
            f"labels of {folder} name the file {name!r}: expected a path inside the dataset"
        )


def _drives(folder: Path) -> dict[int, list[_Image]]:
    """The labels of the images by the number of their scene."""
    drives: dict[int, list[_Image]] = {}
    for path in (folder / name for name in _LABELS if (folder / name).is_file()):
        for image in _read_labels(path).images:
            drives.setdefault(image.scene, []).append(image)
    if not drives:
        raise InputError(
            f"folder {folder} has no images of a drive: expected a dataset of the preset drive"
        )
    return drives


def _read_labels(path: Path) -> _Labels:
    try:
        with open_regular(path) as stream:
            content = stream.read(_LARGEST_LABELS_BYTES + 1)
        if len(content) > _LARGEST_LABELS_BYTES:
            raise InputError(f"it has more than {_LARGEST_LABELS_BYTES} bytes")
        return decode(_Labels, content, "its content")
    except (OSError, InputError) as error:
        raise InputError(
            f"labels {path} cannot be read ({error}): expected those of a drive, as"
            " `perceptree synth --preset drive` writes them"
        ) from error
