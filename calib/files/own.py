"""The project's own camera files: versioned JSON."""

from __future__ import annotations

from calib.camera import PinholeCamera
from calib.errors import CameraError
from calib.files.fields import Values

SCHEMA = "calib.camera/1"


def find(values: Values) -> dict[str, Values]:
    """Return the values if they name a schema."""
    return {"": values} if "schema" in values else {}


def build(values: Values) -> PinholeCamera:
    """Create the camera from the values of ``PinholeCamera.to_dict``."""
    if values["schema"] != SCHEMA:
        raise CameraError(f"schema is {values['schema']!r}, expected {SCHEMA!r}")
    return PinholeCamera.from_dict(values)
