"""Read Label Studio's own JSON, a list of tasks; it keeps masks, keypoints and relations.

Coordinates are percents of the picture's size. Masks painted with a brush are packed bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from basetree.arrays import Float64
from basetree.counts import counted
from perceptree.data.content import holds
from perceptree.data.exchange.brush import unpack_brush
from perceptree.data.exchange.fields import load_json, number, size
from perceptree.data.exchange.shapes import LARGEST_MASK_PX, Shapes, mask_entry
from perceptree.errors import DatasetError

_EXPECTED = "a list of tasks of Label Studio"
_PICTURE_KEYS = ("image", "img", "photo", "picture")
_KINDS = {
    "polygonlabels": "polygon",
    "rectanglelabels": "box",
    "brushlabels": "brush",
    "keypointlabels": "point",
}

Task = dict[str, Any]


def label_studio_files(folder: Path) -> list[Path]:
    """Return the JSON files with tasks of Label Studio in a folder."""
    return [
        path
        for path in sorted(folder.glob("*.json"))
        if holds(path, ("annotations", "result", "data")) and not holds(path, ("categories",))
    ]


def read_label_studio(folder: Path) -> Iterator[tuple[str | None, Path, Task, list[str]]]:
    """Yield (None, file, COCO content, notes) of each file; Label Studio knows no splits.

    Raises:
        DatasetError: If a file is broken.
    """
    for path in label_studio_files(folder) if folder.is_dir() else [folder]:
        tasks = load_json(path, _EXPECTED)
        if not isinstance(tasks, list) or not all(isinstance(task, dict) for task in tasks):
            raise DatasetError(f"{path}: expected {_EXPECTED}")
        shapes, unlabelled = Shapes(), 0
        for task in tasks:
            unlabelled += not _read_task(task, path, shapes)
        content, lost = shapes.content(), shapes.lost_points
        notes = [f"left out: {unlabelled} tasks without annotation"] if unlabelled else []
        notes += [f"left out: {counted(lost, 'point')} in no tree"] if lost else []
        yield None, path, content, notes


def _read_task(task: Task, path: Path, shapes: Shapes) -> bool:
    """Add a task's picture with its last annotation that was not cancelled; False if none."""
    what = f"task {task.get('id', '?')}"
    listed = task.get("annotations")
    kept = [
        one
        for one in (listed if isinstance(listed, list) else [])
        if isinstance(one, dict) and not one.get("was_cancelled")
    ]
    if not kept:
        return False
    results = kept[-1].get("result")
    if not isinstance(results, list) or not all(isinstance(one, dict) for one in results):
        raise DatasetError(f"{path}: the result of {what} is no list of objects")
    sizes = {
        size(one.get("original_width"), one.get("original_height"), path) for one in results
    } - {(None, None)}
    if len(sizes) > 1:
        raise DatasetError(f"{path}: {what} gives its picture two sizes, expected one")
    wide, high = sizes.pop() if sizes else (None, None)
    if wide is None and any(one.get("type") in _KINDS for one in results):
        raise DatasetError(
            f"{path}: {what} has shapes without original_width and original_height, expected both"
        )
    shapes.add_picture(_picture(task, path, what), wide, high)
    parents = _parents(results)
    for one in results:
        if wide is not None and high is not None and one.get("type") in _KINDS:
            _add(one, parents, (wide, high), (path, f"{one.get('id', '?')} of {what}"), shapes)
    return True


def _picture(task: Task, path: Path, what: str) -> str:
    data = task.get("data")
    names = (
        {key: name for key, name in data.items() if isinstance(name, str)}
        if isinstance(data, dict)
        else {}
    )
    chosen = [names[key] for key in _PICTURE_KEYS if key in names] or list(names.values())
    if not chosen:
        raise DatasetError(f"{path}: {what} names no picture, expected one in data.image")
    return chosen[0]


def _parents(results: list[Task]) -> dict[Any, Any]:
    """The region that each result belongs to, by relations and by nesting."""
    parents = {one.get("id"): one["parentID"] for one in results if one.get("parentID")}
    for one in results:
        if one.get("type") == "relation":
            first, second = one.get("from_id"), one.get("to_id")
            kinds = {r.get("id"): r.get("type") for r in results}
            if kinds.get(first) != "keypointlabels":
                first, second = second, first
            parents[first] = second
    return parents


def _add(
    result: Task,
    parents: dict[Any, Any],
    picture: tuple[int, int],
    where: tuple[Path, str],
    shapes: Shapes,
) -> None:
    path, what = where
    value, kind = result.get("value"), _KINDS[result["type"]]
    if not isinstance(value, dict):
        raise DatasetError(f"{path}: result {what} has no value, expected one")
    labels = value.get(result["type"])
    label = str(labels[0]) if isinstance(labels, list) and labels else ""
    own, parent = result.get("id"), parents.get(result.get("id"))

    def px(name: str, axis: int) -> float:
        return number(value.get(name), path, f"{name} of {what}") * picture[axis] / 100

    if kind == "point":
        shapes.add_point(label, px("x", 0), px("y", 1), key=parent)
        return
    keys = [key for key in (own, parent) if key is not None]
    if kind == "box":
        corners = _corners(px("x", 0), px("y", 1), px("width", 0), px("height", 1), value, where)
        turned = bool(value.get("rotation"))
        left, top = corners.min(0).tolist()
        wide, high = (corners.max(0) - corners.min(0)).tolist()
        shape: dict[str, Any] = {"bbox": [left, top, wide, high]}
        if turned:
            shape["segmentation"] = [corners.reshape(-1).tolist()]
    elif kind == "polygon":
        shape = {"segmentation": [_polygon(value.get("points"), picture, where)]}
    else:
        shape = _brush(value, picture, where)
    shapes.add_region(label, shape, keys)


def _corners(
    x: float, y: float, wide: float, high: float, value: Task, where: tuple[Path, str]
) -> Float64:
    """Corners of a box that is turned clockwise about its first corner."""
    angle = np.deg2rad(number(value.get("rotation", 0), where[0], f"rotation of {where[1]}"))
    across = np.array([np.cos(angle), np.sin(angle)]) * wide
    down = np.array([-np.sin(angle), np.cos(angle)]) * high
    offsets: Float64 = np.array([0 * across, across, across + down, down])
    return np.array([x, y]) + offsets


def _polygon(points: Any, picture: tuple[int, int], where: tuple[Path, str]) -> list[float]:
    path, what = where
    if not isinstance(points, list) or not all(
        isinstance(point, list) and len(point) == 2 for point in points
    ):
        raise DatasetError(f"{path}: the points of {what} are no list of x and y")
    return [
        number(share, path, f"a point of {what}") * picture[axis] / 100
        for point in points
        for axis, share in enumerate(point)
    ]


def _brush(value: Task, picture: tuple[int, int], where: tuple[Path, str]) -> dict[str, Any]:
    path, what = where
    packed = value.get("rle")
    pixels = picture[0] * picture[1]
    fits = isinstance(packed, list) and all(type(one) is int and 0 <= one < 256 for one in packed)
    if not fits or pixels > LARGEST_MASK_PX:
        raise DatasetError(f"{path}: the mask of {what} is broken, expected bytes 0 to 255")
    try:
        mask = unpack_brush(bytes(packed or []), pixels).reshape(picture[1], picture[0])
    except ValueError as error:
        raise DatasetError(f"{path}: the mask of {what} is broken ({error})") from error
    return mask_entry(mask)
