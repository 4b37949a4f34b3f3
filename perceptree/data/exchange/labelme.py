"""Read the labels of labelme: a JSON file beside each picture."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from basetree.counts import counted
from basetree.errors import InputFileError
from basetree.files.reading import decode_image
from perceptree.data.content import holds
from perceptree.data.exchange.fields import load_json, number, size
from perceptree.data.exchange.shapes import LARGEST_MASK_PX, Shapes, mask_entry
from perceptree.data.layouts import SPLIT_WORDS
from perceptree.errors import DatasetError

_EXPECTED = "a labelme file"
_CIRCLE_CORNERS = 32
_FLAGS = {"ignore": "ignore", "crowd": "iscrowd"}


def labelme_files(folder: Path) -> list[Path]:
    """Return the files of labelme in a folder and below."""
    return [path for path in sorted(folder.rglob("*.json")) if holds(path, ("shapes", "imagePath"))]


def read_labelme(folder: Path) -> Iterator[tuple[str | None, Path, dict[str, Any], list[str]]]:
    """Yield (split, folder, COCO content, notes) of each split; folders below name the splits.

    Raises:
        DatasetError: If a file is broken.
    """
    splits: dict[str | None, list[Path]] = {}
    for path in labelme_files(folder):
        names = [part.lower() for part in path.parent.relative_to(folder).parts]
        found = {SPLIT_WORDS[name] for name in names if name in SPLIT_WORDS}
        splits.setdefault(found.pop() if len(found) == 1 else None, []).append(path)
    for split, paths in splits.items():
        shapes = Shapes()
        for path in paths:
            _read_file(path, folder, shapes)
        content = shapes.content()
        lost = shapes.lost_points
        notes = [f"left out: {counted(lost, 'point')} in no tree"] if lost else []
        yield split, folder / "labelme.json", content, notes


def _read_file(path: Path, folder: Path, shapes: Shapes) -> None:
    content = load_json(path, _EXPECTED)
    if not isinstance(content, dict) or not isinstance(content.get("shapes"), list):
        raise DatasetError(f"{path}: expected {_EXPECTED} with a list of shapes")
    name = str(content.get("imagePath", "")).replace("\\", "/").rpartition("/")[2]
    wide, high = size(content.get("imageWidth"), content.get("imageHeight"), path)
    shapes.add_picture((path.parent / name).relative_to(folder).as_posix(), wide, high)
    for place, shape in enumerate(content["shapes"], start=1):
        if not isinstance(shape, dict):
            raise DatasetError(f"{path}: shape {place} is no object, expected one")
        _add(shape, f"shape {place}", path, shapes, (wide, high))


def _add(
    shape: dict[str, Any],
    what: str,
    path: Path,
    shapes: Shapes,
    picture: tuple[int | None, int | None],
) -> None:
    label, kind = str(shape.get("label", "")), shape.get("shape_type", "polygon")
    points = _points(shape.get("points"), what, path)
    group = shape.get("group_id")
    key = None if not isinstance(group, int | str) else group
    keys = () if key is None else (key,)
    if kind == "point" and len(points) == 1:
        hidden = _flags(shape).get("hidden", False)
        shapes.add_point(label, *points[0], 1 if hidden else 2, key)
        return
    marks = {field: 1 for flag, field in _FLAGS.items() if _flags(shape).get(flag)}
    if kind == "mask" and len(points) == 2:
        runs = _mask(shape.get("mask"), points[0], picture, what, path)
        shapes.add_region(label, runs, keys, **marks)
    elif kind in ("polygon", "linestrip", "rectangle", "circle"):
        polygon = _outline(str(kind), points)
        shapes.add_region(label, {"segmentation": [polygon]}, keys, **marks)
    else:
        raise DatasetError(
            f"{path}: {what} is a {str(kind)[:40]!r} of {len(points)} points, expected a polygon,"
            " rectangle, circle, mask or point"
        )


def _flags(shape: dict[str, Any]) -> dict[str, Any]:
    flags = shape.get("flags")
    return flags if isinstance(flags, dict) else {}


def _points(points: Any, what: str, path: Path) -> list[tuple[float, float]]:
    if not isinstance(points, list) or not all(
        isinstance(point, list) and len(point) == 2 for point in points
    ):
        raise DatasetError(f"{path}: the points of {what} are no list of x and y")
    return [(number(x, path, f"x of {what}"), number(y, path, f"y of {what}")) for x, y in points]


def _outline(kind: str, points: list[tuple[float, float]]) -> list[float]:
    """The polygon x, y, ... of a shape; a circle is given by its middle and a point on it."""
    if kind == "rectangle" and len(points) == 2:
        (x0, y0), (x1, y1) = points
        points = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    elif kind == "circle" and len(points) == 2:
        (x, y), edge = points[0], points[1]
        radius = float(np.hypot(edge[0] - x, edge[1] - y))
        angles = np.linspace(0, 2 * np.pi, _CIRCLE_CORNERS, endpoint=False)
        points = [(x + radius * float(np.cos(a)), y + radius * float(np.sin(a))) for a in angles]
    return [value for point in points for value in point]


def _mask(
    text: Any,
    corner: tuple[float, float],
    picture: tuple[int | None, int | None],
    what: str,
    path: Path,
) -> dict[str, Any]:
    """Run lengths of a mask that is stored as a PNG, whose corner lies at a point."""
    try:
        data = base64.b64decode(text, validate=True)
        pixels = decode_image(data, cv2.IMREAD_UNCHANGED, f"{path}: the mask of {what}")
    except (TypeError, ValueError, binascii.Error, InputFileError):
        pixels = None
    if pixels is None or pixels.ndim != 2 or None in picture:
        raise DatasetError(f"{path}: the mask of {what} cannot be read, expected a PNG in base64")
    wide, high = (int(value or 0) for value in picture)
    if wide * high > LARGEST_MASK_PX:
        raise DatasetError(f"{path}: the picture is {wide}x{high} px, which is too large")
    whole = np.zeros((high, wide), np.bool_)
    left, top = (round(value) for value in corner)
    part = whole[max(top, 0) : max(top + pixels.shape[0], 0), max(left, 0) :]
    inner = pixels[max(-top, 0) :, max(-left, 0) :][: part.shape[0], : part.shape[1]]
    part[: inner.shape[0], : inner.shape[1]] = inner > 0
    return mask_entry(whole)
