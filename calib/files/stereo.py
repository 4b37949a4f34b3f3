"""Read the calibration of a stereo pair: both cameras, and where they stand to each other.

- The project's own JSON: left, right, and right_from_left as a transform.
- Kalibr's camchain: cam0 and cam1 with T_cn_cnm1, or T_cam_imu of both.
- OpenCV's stereo_calib: M1, D1, M2, D2 (or K_LEFT and the like) with R and T in one file, or R and
  T in `extrinsics.yml` beside `intrinsics.yml`.
- KITTI's calib.txt (P0 to P3) and calib_cam_to_cam.txt (P_rect_02, P_rect_03): rectified pictures.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from basetree.arrays import Float
from basetree.errors import InputError, InputFileError
from basetree.files.json import json_text
from basetree.files.reading import read_text
from basetree.files.writing import write_text
from calib.camera import PinholeCamera
from calib.distortion import RADTAN
from calib.errors import CameraError
from calib.files import kalibr, opencv
from calib.files.cameras import check_pixels
from calib.files.fields import choices_of, numbers, one_of
from calib.files.text import parse
from calib.sizeless import sizeless_camera
from calib.stereo import StereoPair
from calib.transform import RigidTransform

SCHEMA: Final = "calib.stereo/1"

_EXPECTED: Final = "the calibration of a stereo pair"
_KITTI: Final = re.compile(
    r"^(P[0-3]|P_rect_0[0-3]):((?:\s+[-+.\deE]{1,40}){12})\s*$", re.MULTILINE
)
_KITTI_PAIRS: Final = (("P2", "P3"), ("P0", "P1"), ("P_rect_02", "P_rect_03"))
_KITTI_PAIRS_GREY: Final = (("P_rect_00", "P_rect_01"),)
_KITTI_SIZE: Final = re.compile(
    r"^S_rect_0[02]:\s+([\d.eE+]{1,20})\s+([\d.eE+]{1,20})", re.MULTILINE
)
_ROTATION: Final = ("R", "rotation", "Rotation")
_TRANSLATION: Final = ("T", "translation", "Translation", "t")
_BESIDE: Final = ("extrinsics.yml", "extrinsics.yaml", "extrinsics.xml")


def load_stereo(path: Path | str) -> StereoPair:
    """Read the calibration of a stereo pair; the format is recognised by the content.

    Raises:
        InputFileError: If the file is missing, unreadable or of no known format.
        CameraError: If a value is invalid, or the cameras do not stand side by side; the message
            names the file.
    """
    path = Path(path)
    text = read_text(path, _EXPECTED)
    try:
        if matrices := dict(_KITTI.findall(text)):
            pair = _of_projections(matrices, _KITTI_SIZE.search(text))
        else:
            values = parse(path, text, _EXPECTED)
            if not isinstance(values, Mapping):
                raise InputFileError(f"{path}: no map of values, expected {_EXPECTED}")
            with choices_of(str(path)):
                pair = _of_values(path, values)
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from error
    for camera in (pair.left, pair.right):
        check_pixels(str(path), camera)
    return pair


def save_stereo(path: Path | str, pair: StereoPair) -> None:
    """Write the calibration of a stereo pair as JSON.

    Raises:
        InputFileError: If the file cannot be written.
    """
    transform = pair.right_from_left
    values = {
        "left": pair.left.to_dict(),
        "right": pair.right.to_dict(),
        "right_from_left": {
            "rotation": transform.rotation.tolist(),
            "translation_m": transform.translation_m.tolist(),
        },
    }
    write_text(Path(path), json_text(SCHEMA, values))


def _of_values(path: Path, values: Mapping[str, Any]) -> StereoPair:
    if values.get("schema") == SCHEMA:
        return _own(values)
    if cameras := kalibr.find(values):
        return _of_kalibr(cameras)
    sides = opencv.find_sides(values)
    by_side = {alias: side for side in sides.values() for alias in side.get("aliases", ())}
    if "left" in by_side and "right" in by_side:
        found = {**_beside(path, values), **values}
        left, right = (opencv.build_side(by_side[side]) for side in ("left", "right"))
        name = one_of(found, *_present(found, _ROTATION))
        rotation = numbers(found, name)
        if len(rotation) != 9:
            hint = ", as cv2.Rodrigues makes of a rotation vector" if len(rotation) == 3 else ""
            raise CameraError(f"{name} has {len(rotation)} numbers: expected 3x3{hint}")
        place = np.array(numbers(found, one_of(found, *_present(found, _TRANSLATION))))
        return StereoPair(left, right, _transform(np.reshape(rotation, (3, 3)), place))
    raise InputFileError(
        f"{path}: no known format of a stereo pair, expected {SCHEMA}, a Kalibr camchain of two"
        " cameras, OpenCV's M1, D1, M2, D2 with R and T, or KITTI's calib.txt"
    )


def _present(values: Mapping[str, Any], names: tuple[str, ...]) -> tuple[str, ...]:
    """The first of several names that is there, or all for the message that none is."""
    found = next((name for name in names if name in values), None)
    return names if found is None else (found,)


def _beside(path: Path, values: Mapping[str, Any]) -> Mapping[str, Any]:
    """The values of OpenCV's second file, if the first has no R and T."""
    if any(name in values for name in _ROTATION):
        return {}
    other = next((path.with_name(name) for name in _BESIDE if path.with_name(name).is_file()), None)
    if other is None:
        return {}
    found = parse(other, read_text(other, _EXPECTED), _EXPECTED)
    return found if isinstance(found, Mapping) else {}


def _own(values: Mapping[str, Any]) -> StereoPair:
    for name in ("left", "right", "right_from_left"):
        if not isinstance(values.get(name), Mapping):
            raise CameraError(f"{name} is {values.get(name)!r:.40}: expected a map")
    transform = values["right_from_left"]
    rotation = np.array(transform.get("rotation"), dtype=object)
    place = np.array(transform.get("translation_m"), dtype=object)
    return StereoPair(
        PinholeCamera.from_dict(values["left"]),
        PinholeCamera.from_dict(values["right"]),
        _transform(rotation, place),
    )


def _of_kalibr(cameras: Mapping[str, Mapping[str, Any]]) -> StereoPair:
    names = sorted(cameras)
    if len(names) != 2:
        raise CameraError(f"it holds {len(names)} cameras ({', '.join(names)}): expected a pair")
    left, right = (cameras[name] for name in names)
    if "T_cn_cnm1" in right:
        matrix = _matrix4(right, "T_cn_cnm1")
    else:
        matrix = _matrix4(right, "T_cam_imu") @ np.linalg.inv(_matrix4(left, "T_cam_imu"))
    transform = _transform(matrix[:3, :3], matrix[:3, 3])
    return StereoPair(kalibr.build(left), kalibr.build(right), transform)


def _matrix4(values: Mapping[str, Any], name: str) -> Float:
    rows = values.get(name)
    is_rows = isinstance(rows, list) and all(isinstance(row, list) for row in rows)
    flat = [each for row in rows or () for each in row] if is_rows else rows
    found = numbers({name: flat}, name) if isinstance(flat, list) else ()
    if len(found) != 16:
        raise CameraError(f"{name} is {rows!r:.60}: expected 4x4 numbers, from cam0 to cam1")
    matrix = np.reshape(found, (4, 4))
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 0.5:
        raise CameraError(f"{name} is no rigid transform: expected a rotation and metres")
    return matrix


def _of_projections(matrices: Mapping[str, str], size: re.Match[str] | None) -> StereoPair:
    """The rectified pair of KITTI: the fourth column is -f times the place to the right."""
    pairs = (*_KITTI_PAIRS, *_KITTI_PAIRS_GREY)
    pair = next((pair for pair in pairs if all(name in matrices for name in pair)), None)
    if pair is None:
        raise CameraError(f"it has {', '.join(matrices)}: expected P2 and P3, or P0 and P1")
    left, right = (np.reshape(numbers(matrices, name), (3, 4)) for name in pair)
    fx, cx, fy, cy = (float(left[i, j]) for i, j in ((0, 0), (0, 2), (1, 1), (1, 2)))
    if not np.allclose(left[:, :3], right[:, :3], rtol=1e-6) or not fx > 0:
        raise CameraError(f"{pair[0]} and {pair[1]} have other lenses: expected a rectified pair")
    across_m = (left[0, 3] - right[0, 3]) / fx
    camera: PinholeCamera = sizeless_camera(fx, fy, cx, cy, (), RADTAN)
    if size is not None:  # which calib.txt of the odometry does not state
        sides = {"S_rect": " ".join(size.groups())}
        width, height = (round(each) for each in numbers(sides, "S_rect"))
        camera = PinholeCamera(width, height, fx, fy, cx, cy)
    return StereoPair(camera, camera, _transform(np.eye(3), np.array([-across_m, 0.0, 0.0])))


def _transform(rotation: Any, translation: Any) -> RigidTransform:
    try:
        return RigidTransform(rotation, np.reshape(translation, -1))
    except InputError as error:
        raise CameraError(f"the transform from the left camera to the right: {error}") from error
