"""A camera matrix alone: metadata of Record3D, and 3x3 numbers as Stray Scanner and NumPy write."""

from __future__ import annotations

import re
from typing import Any

from calib.camera import PinholeCamera
from calib.files.fields import Values, camera, matrix, number, numbers, size, tell_choice

_NUMBER = r"[-+]?\d{1,40}(?:\.\d{0,40})?(?:[eE][-+]?\d{1,3})?"
_ROW = re.compile(rf"\s*\[*\s*({_NUMBER})[\s,;]+({_NUMBER})[\s,;]+({_NUMBER})[\s,;]*\]*[\s,]*")


def parse_text(text: str) -> dict[str, Any]:
    """Return the matrix of a text of three rows of three numbers; empty for another text."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    rows = [_ROW.fullmatch(line) for line in lines] if len(lines) == 3 else []
    found = [float(value) for row in rows if row for value in row.groups()]
    return {"rows of a matrix": found} if len(found) == 9 else {}


def find(values: Values) -> dict[str, Values]:
    """Return the camera of a text of three rows."""
    return {"": values} if "rows of a matrix" in values else {}


def build(values: Values) -> PinholeCamera:
    """Create the camera, without distortion."""
    focal_px = matrix(values, "rows of a matrix")
    tell_choice("it holds a camera matrix alone: taken for a camera without distortion")
    return camera(None, focal_px, ())


def find_record3d(values: Values) -> dict[str, Values]:
    """Return the camera if there are K, w and h."""
    return {"": values} if all(name in values for name in ("K", "w", "h")) else {}


def build_record3d(values: Values) -> PinholeCamera:
    """Create the camera of the colour pictures, without distortion; K goes column by column."""
    found = numbers(values, "K")
    by_columns = len(found) == 9 and not any((found[2], found[5]))
    rows = [found[i + 3 * j] for i in range(3) for j in range(3)] if by_columns else found
    size_px = size({"width": number(values, "w"), "height": number(values, "h")})
    return camera(size_px, matrix({"K": list(rows)}, "K"), ())
