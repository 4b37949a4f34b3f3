"""The project's own camera files: versioned JSON, or the values of a camera alone."""

from __future__ import annotations

from calib.camera import PinholeCamera
from calib.errors import CameraError
from calib.files.fields import Values

SCHEMA = "calib.camera/1"

_PINHOLE = ("fx", "fy", "cx", "cy")
_STDS = ("focal_std_px", "principal_std_px")
_FIELDS = ("width", "height", *_PINHOLE, "distortion", "distortion_model", *_STDS)


def find(values: Values) -> dict[str, Values]:
    """Return the values if they name a schema."""
    return {"": values} if "schema" in values else {}


def build(values: Values) -> PinholeCamera:
    """Create the camera from the values of `PinholeCamera.to_dict`."""
    if values["schema"] != SCHEMA:
        raise CameraError(f"schema is {values['schema']!r}, expected {SCHEMA!r}")
    return PinholeCamera.from_dict(values)


def find_plain(values: Values) -> dict[str, Values]:
    """Return the values if they hold fx, fy, cx and cy."""
    return {"": values} if all(name in values for name in _PINHOLE) else {}


def build_plain(values: Values) -> PinholeCamera:
    """Create the camera from the values of `PinholeCamera.to_dict` without a schema.

    Such a file may be another tool's, so other fields, such as k1, are refused.
    """
    unknown = sorted(str(name) for name in values if name not in _FIELDS)
    if unknown:
        raise CameraError(
            f"the file has {', '.join(unknown)} and no schema: expected only {', '.join(_FIELDS)}"
        )
    return PinholeCamera.from_dict(values)
