"""Captures of Record3D: `.r3d` files, and the folders that they unpack to.

An `.r3d` file is a zip file:

    metadata        JSON: w, h, K (column by column), fps, dw, dh, poses (qx, qy, qz, qw, x, y, z),
                    initPose, frameTimestamps, perFrameIntrinsicCoeffs (fx, fy, cx, cy)
    rgbd/0.jpg      colour, upright
    rgbd/0.depth    float32 metres in LZFSE
    rgbd/0.conf     bytes 0, 1 or 2 in LZFSE; older captures have none

Poses are from OpenGL's camera axes (x right, y up, z backwards) to a world with y up. That is
ARKit's world, which follows gravity, or the first camera's: then the first pose is no rotation, and
`initPose` leads to ARKit's world if it is stored. Captures of the front camera have no poses.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

import calib
from basetree.errors import InputError
from basetree.files.json import decode
from basetree.files.picture_size import most_picture_bytes
from basetree.files.reading import decode_picture
from edgetree.frames.rig import Rig
from edgetree.sources.phones.capture import (
    MOST_FRAMES,
    Capture,
    PhoneFrame,
    stored_pose,
    with_z_up,
)
from edgetree.sources.phones.lzfse import unpack, unpacked_bytes
from edgetree.sources.phones.members import Members

SUFFIX: Final = ".r3d"
_METADATA: Final = ("metadata", "metadata.json")
_LARGEST_METADATA_BYTES: Final = 2**27
_PICTURE: Final = re.compile(r"rgbd/([0-9]{1,9})\.jpg")
_OPENGL: Final = np.diag([1.0, -1.0, -1.0])
_SAME_ROTATION: Final = 1e-4  # of a quaternion's vector part
_SAME_POSE: Final = 0.999  # the product of two quaternions, 5 degrees
_DEPTH_SIZES: Final = ((192, 256), (256, 192), (720, 960), (640, 480), (480, 640))
_METRE_BYTES: Final = 4


@dataclass(frozen=True)
class _Metadata:
    """The metadata, as far as frames need them; sizes in px."""

    w: int
    h: int
    K: tuple[float, ...]
    dw: int | None = None
    dh: int | None = None
    fps: float = 60.0
    poses: tuple[tuple[float, ...], ...] = ()
    initPose: tuple[float, ...] | None = None
    frameTimestamps: tuple[float, ...] = ()
    perFrameIntrinsicCoeffs: tuple[tuple[float, ...] | None, ...] = ()

    def __post_init__(self) -> None:
        if len(self.K) != 9:
            raise ValueError(f"K has {len(self.K)} numbers, expected 9, column by column")
        if not (0 < self.w < 2**15 and 0 < self.h < 2**15):
            raise ValueError(f"the pictures are {self.w}x{self.h} px, expected 1 to 32767")
        if not 0 < self.fps < 1000:
            raise ValueError(f"fps is {self.fps}, expected frames per second")
        for pose in (*self.poses, self.initPose or (0.0,) * 7):
            if len(pose) != 7:
                raise ValueError(f"a pose has {len(pose)} numbers, expected 7")
        if len(self.poses) > MOST_FRAMES:
            raise ValueError(f"{len(self.poses)} poses, expected at most {MOST_FRAMES}")


def is_record3d(path: Path) -> bool:
    """Whether a path is an `.r3d` file, or the folder that one was unpacked to."""
    if path.is_dir():
        return any((path / name).is_file() for name in _METADATA) and (path / "rgbd").is_dir()
    return path.suffix.lower() == SUFFIX and path.is_file()


def is_exr_export(path: Path) -> bool:
    """Whether a folder is Record3D's export with depth as EXR, which is not read."""
    return (path / "metadata.json").is_file() and any((path / "depth").glob("*.exr"))


def open_record3d(path: Path, *, rig: Rig | None = None) -> Capture:
    """Open a capture of Record3D.

    Args:
        path: An `.r3d` file, or the folder that it was unpacked to.
        rig: Cameras that take the place of the capture's, and the correction of the depth.

    Returns:
        Its frames, with colour, depth, camera, time, and pose and gravity where they are stored.
        Frames that cannot be read are left out.

    Raises:
        InputError: It is no such capture.
        MissingPackage: The package that unpacks the depth is not installed.
    """
    return _Record3D(path, rig or Rig())


class _Record3D(Capture):
    def __init__(self, path: Path, rig: Rig) -> None:
        self._members = Members(path)
        found = map(_PICTURE.fullmatch, self._members.names)
        self._numbers = sorted(int(match[1]) for match in found if match is not None)
        super().__init__(path, rig, len(self._numbers))
        name = next((name for name in _METADATA if name in self._members.names), _METADATA[0])
        content = self._members.read(name, _LARGEST_METADATA_BYTES)
        try:
            self._metadata = decode(_Metadata, content, f"{name} of {path}")
        except ValueError as error:
            raise InputError(f"{name} of {path}: {error}") from error
        self._poses, self._has_gravity = _world_poses(self._metadata)
        self._camera(0)  # an impossible one ends it here
        self._depth(self._numbers[0])  # and so does a package that lacks

    def close(self) -> None:
        """End an iteration in progress; the capture cannot be read any more."""
        super().close()
        self._members.close()

    def _stored(self) -> Iterator[PhoneFrame | InputError]:
        for place, number in enumerate(self._numbers):
            try:
                yield self._one(place, number)
            except InputError as error:
                yield error

    def _one(self, place: int, number: int) -> PhoneFrame:
        metadata, members = self._metadata, self._members
        where = f"rgbd/{number}.jpg of {self._path}"
        data = members.read(f"rgbd/{number}.jpg", most_picture_bytes())
        picture = decode_picture(data, cv2.IMREAD_COLOR, where)
        if picture is None or picture.pixels.dtype != np.uint8:
            raise InputError(f"{where} cannot be read: expected a JPEG")
        # Numbers are those of the poses, but for captures of which a part was cut away.
        row = number if self._numbers[-1] < len(self._poses) else place
        times = metadata.frameTimestamps
        depth = self._depth(number)
        return PhoneFrame(
            f"{self._path.stem}_{number:06d}",
            np.asarray(picture.pixels, np.uint8),
            depth,
            self._confidence(number, depth.shape),
            self._camera(row),
            times[row] if row < len(times) else number / metadata.fps,
            self._poses[row] if row < len(self._poses) else None,
            self._has_gravity,
        )

    def _depth(self, number: int) -> NDArray[np.float32]:
        data, where = self._packed(f"rgbd/{number}.depth")
        try:
            stated = unpacked_bytes(data)
            if stated > most_picture_bytes():
                raise InputError(
                    f"it unpacks to {stated} bytes: expected at most {most_picture_bytes()}"
                )
            width, height = self._depth_size(stated)
            content = unpack(data, stated)
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
        return np.frombuffer(content, "<f4").reshape(height, width).astype(np.float32)

    def _depth_size(self, stated: int) -> tuple[int, int]:
        """Width and height of a depth map of so many bytes."""
        metadata = self._metadata
        own = ((metadata.dw or 0, metadata.dh or 0), (metadata.w, metadata.h))
        for width, height in (*own, *_DEPTH_SIZES):
            is_shape = width * metadata.h == height * metadata.w or width == metadata.dw
            if stated and is_shape and width * height * _METRE_BYTES == stated:
                return width, height
        raise InputError(
            f"it has {stated / _METRE_BYTES:g} values: expected {metadata.dw or 192} x"
            f" {metadata.dh or 256}"
        )

    def _confidence(self, number: int, shape: tuple[int, ...]) -> NDArray[np.uint8] | None:
        name = f"rgbd/{number}.conf"
        if name not in self._members.names:
            return None
        data, where = self._packed(name)
        try:
            content = unpack(data, shape[0] * shape[1])
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
        return np.frombuffer(content, np.uint8).reshape(shape)

    def _packed(self, name: str) -> tuple[bytes, str]:
        return self._members.read(name, most_picture_bytes()), f"{name} of {self._path}"

    def _camera(self, row: int) -> calib.PinholeCamera:
        metadata = self._metadata
        fx, fy, cx, cy = (metadata.K[index] for index in (0, 4, 6, 7))
        own = metadata.perFrameIntrinsicCoeffs
        focus = own[row] if row < len(own) else None
        if focus is not None and len(focus) == 4 and focus[0] > 0 and focus[1] > 0:
            fx, fy, cx, cy = focus
        return calib.PinholeCamera(metadata.w, metadata.h, fx, fy, cx, cy)


def _world_poses(metadata: _Metadata) -> tuple[list[calib.RigidTransform], bool]:
    """Poses of all frames, and whether their world follows gravity."""
    stored = metadata.poses
    if not stored or all(_is_unturned(pose) and not any(pose[4:]) for pose in stored):
        return [], False
    poses = [stored_pose(pose[:4], pose[4:]) for pose in stored]
    start = metadata.initPose
    has_start = start is not None and not _is_unturned(start)
    has_gravity = not has_start
    if _is_unturned(stored[0]):
        has_gravity = has_start
        if start is not None:
            first = stored_pose(start[:4], start[4:])
            poses = [pose.then(first) for pose in poses]
    elif start is not None and has_start:
        # Relative poses of which the beginning was cut away, unless the first is the start itself.
        has_gravity = abs(float(np.dot(start[:4], stored[0][:4]))) > _SAME_POSE
    return [with_z_up(pose, _OPENGL) for pose in poses], has_gravity


def _is_unturned(pose: tuple[float, ...]) -> bool:
    return all(abs(value) < _SAME_ROTATION for value in pose[:3])
