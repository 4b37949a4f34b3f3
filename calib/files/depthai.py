"""Calibration of Luxonis OAK cameras, JSON as DepthAI writes the content of their memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calib.camera import PinholeCamera
from calib.distortion import FISHEYE, RADTAN
from calib.errors import CameraError
from calib.files.fields import Values, camera, matrix, number, numbers, size

_TYPES = {0: RADTAN, 1: FISHEYE}
_FISHEYE_TERMS = 4


def find(values: Values) -> dict[str, Values]:
    """Return the cameras by their sockets: CAM_A for the first, CAM_B and CAM_C for its pair."""
    data = values.get("cameraData")
    pairs = data.items() if isinstance(data, Mapping) else data if isinstance(data, list) else ()
    found: dict[str, Values] = {}
    for pair in pairs:
        if isinstance(pair, list | tuple) and len(pair) == 2 and isinstance(pair[1], Mapping):
            name = _socket(pair[0])
            found[name] = {**pair[1], "aliases": (name.lower(), str(pair[0]))}
    return found


def _socket(number_of_socket: Any) -> str:
    text = str(number_of_socket)
    return f"CAM_{chr(ord('A') + int(text))}" if text in list("01234567") else text


def build(values: Values) -> PinholeCamera:
    """Create the camera of the raw image; fisheye lenses have four terms."""
    terms = numbers(values, "distortionCoeff")
    kind = number({"cameraType": 0, **values}, "cameraType")
    if kind not in _TYPES:
        raise CameraError(f"cameraType is {kind:g}: expected 0 (perspective) or 1 (fisheye)")
    model = _TYPES[int(kind)]
    if model == FISHEYE:
        if any(terms[_FISHEYE_TERMS:]):
            raise CameraError(
                f"distortionCoeff is {list(terms)}: expected four terms of a fisheye lens, then 0"
            )
        terms = terms[:_FISHEYE_TERMS]
    return camera(size(values), matrix(values, "intrinsicMatrix"), terms, model)
