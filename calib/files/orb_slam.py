"""Settings of ORB-SLAM2 and ORB-SLAM3: OpenCV YAML with fields such as Camera1.fx."""

from __future__ import annotations

from calib.camera import PinholeCamera
from calib.distortion import FISHEYE, RADTAN
from calib.errors import CameraError
from calib.files.fields import Values, camera, matrix, number, numbers, size

_CAMERAS = ("Camera", "Camera1", "Camera2")
_RAW = ("LEFT", "RIGHT")  # ORB-SLAM2: the two cameras before rectification to Camera
_FIVE = ("k1", "k2", "p1", "p2", "k3")
_FISHEYE = ("k1", "k2", "k3", "k4")
_TERMS = {"PinHole": _FIVE, "Rectified": (), "KannalaBrandt8": _FISHEYE}


def find(values: Values) -> dict[str, Values]:
    """Return the cameras by the first part of their fields, such as Camera1 of Camera1.fx."""
    names = [name for name in _CAMERAS if f"{name}.fx" in values]
    names += [name for name in _RAW if f"{name}.K" in values]
    return {name: {**values, "name": name} for name in names}


def build(values: Values) -> PinholeCamera:
    """Create the camera; ORB-SLAM2 has no Camera.type and means PinHole."""
    name = values["name"]
    if name in _RAW:
        size_px = _size(values, name)
        return camera(size_px, matrix(values, f"{name}.K"), numbers(values, f"{name}.D"))
    size_px = _size(values, "Camera")
    kind = values.get("Camera.type", "PinHole")
    if not isinstance(kind, str) or kind not in _TERMS:
        raise CameraError(f"Camera.type is {kind!r}: expected {', '.join(_TERMS)}")
    focal = [number(values, f"{name}.{field}") for field in ("fx", "fy", "cx", "cy")]
    for term in dict.fromkeys((*_FIVE, *_FISHEYE, "k5", "k6")):
        field = f"{name}.{term}"
        if term not in _TERMS[kind] and field in values and number(values, field):
            raise CameraError(f"{field} is {values[field]}: expected no {term} of a {kind} camera")
    if kind == "KannalaBrandt8":
        return camera(size_px, focal, _terms(values, name, _FISHEYE), FISHEYE)
    if not any(f"{name}.{term}" in values for term in _TERMS[kind]):
        return camera(size_px, focal, (), RADTAN)
    terms = _FIVE if f"{name}.k3" in values else _FIVE[:4]
    return camera(size_px, focal, _terms(values, name, terms))


def _terms(values: Values, name: str, terms: tuple[str, ...]) -> list[float]:
    return [number(values, f"{name}.{term}") for term in terms]


def _size(values: Values, name: str) -> tuple[int, int] | None:
    """Return width and height in px; older settings have neither."""
    fields = {"width": f"{name}.width", "height": f"{name}.height"}
    missing = [field for field in fields.values() if field not in values]
    if missing:
        raise CameraError(
            f"{' and '.join(missing)} missing: expected the size of the image in px; add it to"
            " the file"
        )
    return size({side: number(values, field) for side, field in fields.items()})
