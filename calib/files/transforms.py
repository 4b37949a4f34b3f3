"""Read and write rigid transforms as versioned JSON."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from basetree.errors import InputError
from basetree.files.json import json_text
from basetree.files.writing import write_text
from calib.files.text import parse_record
from calib.transform import RigidTransform, check_on_machine

SCHEMA = "calib.transform/1"

_EXPECTED = "a transform as JSON"
_ROTATIONS = ("rotation", "quaternion_xyzw", "roll_pitch_yaw_deg")
_ANGLES = ("roll_deg", "pitch_deg", "yaw_deg")


def load_transform(path: Path | str) -> RigidTransform:
    """Read a transform.

    The file holds either `translation_m` and one of `rotation` (3x3), `quaternion_xyzw` and
    `roll_pitch_yaw_deg`, or a `mounting` with `position_m` and the angles of
    `RigidTransform.mounting`.

    Raises:
        InputFileError: If the file is missing, unreadable or has another schema.
        InputError: If a value is invalid; the message names the file.
    """
    path = Path(path)
    values = parse_record(path, SCHEMA, _EXPECTED)
    try:
        transform = _build(values)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
    check_on_machine(transform, str(path))
    return transform


def _build(values: Mapping[str, Any]) -> RigidTransform:
    given = sorted(str(name) for name in values if name != "schema")
    rotations = [name for name in _ROTATIONS if name in values]
    if given == ["mounting"]:
        return _mounting(values["mounting"])
    if len(rotations) != 1 or given != sorted([*rotations, "translation_m"]):
        raise InputError(
            f"the fields are {given}: expected translation_m and one of {', '.join(_ROTATIONS)},"
            " or mounting alone"
        )
    rotation, translation_m = values[rotations[0]], values["translation_m"]
    if rotations[0] == "rotation":
        return RigidTransform(rotation, translation_m)
    if rotations[0] == "quaternion_xyzw":
        return RigidTransform.from_quaternion(rotation, translation_m)
    if not isinstance(rotation, list) or len(rotation) != 3:
        raise InputError(f"roll_pitch_yaw_deg is {rotation!r}: expected three numbers")
    roll, pitch, yaw = rotation
    return RigidTransform.from_euler_deg(roll, pitch, yaw, translation_m)


def _mounting(values: Any) -> RigidTransform:
    known = isinstance(values, Mapping) and set(values) <= {"position_m", *_ANGLES}
    if not known or "position_m" not in values:
        found = sorted(map(str, values)) if isinstance(values, Mapping) else repr(values)
        raise InputError(f"mounting has {found}: expected position_m, {', '.join(_ANGLES)}")
    angles = {name: values.get(name, 0.0) for name in _ANGLES}
    return RigidTransform.mounting(values["position_m"], **angles)


def save_transform(path: Path | str, transform: RigidTransform) -> None:
    """Write a transform as JSON, with its rotation as a matrix.

    Raises:
        InputFileError: If the file cannot be written.
    """
    values = {
        "rotation": transform.rotation.tolist(),
        "translation_m": transform.translation_m.tolist(),
    }
    write_text(Path(path), json_text(SCHEMA, values))
