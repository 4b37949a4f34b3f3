"""Rigid transforms on disk: versioned JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calib.errors import CalibError, InputFileError
from calib.files.text import parse, read_text
from calib.transform import RigidTransform
from calib.writing import write_whole

SCHEMA = "calib.transform/1"

_EXPECTED = "a transform as JSON"
_TURNS = ("rotation", "quaternion_xyzw", "roll_pitch_yaw_deg")
_ANGLES = ("roll_deg", "pitch_deg", "yaw_deg")


def load_transform(path: Path | str) -> RigidTransform:
    """Read a transform: ``translation_m`` and one kind of turn, or a ``mounting``.

    The turn is ``rotation`` (3x3), ``quaternion_xyzw`` or ``roll_pitch_yaw_deg``; a mounting holds
    ``position_m`` and the angles of ``RigidTransform.mounting``. Raises InputFileError for a file
    that is none, CalibError with the file's name for values that are no transform.
    """
    path = Path(path)
    values = parse(path, read_text(path, _EXPECTED), _EXPECTED)
    found = values.get("schema") if isinstance(values, Mapping) else type(values).__name__
    if not isinstance(values, Mapping) or found != SCHEMA:
        raise InputFileError(f"{path}: schema is {found!r}, expected {SCHEMA!r}")
    try:
        return _build(values)
    except CalibError as error:
        raise type(error)(f"{path}: {error}") from error


def _build(values: Mapping[str, Any]) -> RigidTransform:
    given = sorted(set(values) - {"schema"})
    turns = [name for name in _TURNS if name in values]
    if given == ["mounting"]:
        return _mounting(values["mounting"])
    if len(turns) != 1 or given != sorted([*turns, "translation_m"]):
        raise CalibError(
            f"the fields are {given}: expected translation_m and one of {', '.join(_TURNS)},"
            " or mounting alone"
        )
    turn, translation_m = values[turns[0]], values["translation_m"]
    if turns[0] == "rotation":
        return RigidTransform(turn, translation_m)
    if turns[0] == "quaternion_xyzw":
        return RigidTransform.from_quaternion(turn, translation_m)
    if not isinstance(turn, list) or len(turn) != 3:
        raise CalibError(f"roll_pitch_yaw_deg is {turn!r}: expected three numbers")
    roll, pitch, yaw = turn
    return RigidTransform.from_euler_deg(roll, pitch, yaw, translation_m)


def _mounting(values: Any) -> RigidTransform:
    known = isinstance(values, Mapping) and set(values) <= {"position_m", *_ANGLES}
    if not known or "position_m" not in values:
        found = sorted(values) if isinstance(values, Mapping) else repr(values)
        raise CalibError(f"mounting has {found}: expected position_m, {', '.join(_ANGLES)}")
    angles = {name: values.get(name, 0.0) for name in _ANGLES}
    return RigidTransform.mounting(values["position_m"], **angles)


def save_transform(path: Path | str, transform: RigidTransform) -> None:
    """Write a transform as its matrix; raises InputFileError where that cannot be done."""
    values = {
        "schema": SCHEMA,
        "rotation": transform.rotation.tolist(),
        "translation_m": transform.translation_m.tolist(),
    }
    write_whole(Path(path), f"{json.dumps(values, indent=1)}\n".encode())
