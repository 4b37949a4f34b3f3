"""Read CVAT's own XML ("CVAT for images 1.1"), which holds masks, skeletons and points together."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from basetree.arrays import Float64
from basetree.counts import counted
from basetree.files.reading import read_text
from basetree.files.regular import open_regular
from calib import encode_rle
from perceptree.data.exchange.fields import LARGEST_LABELS_BYTES, number, numbers, size
from perceptree.data.exchange.shapes import LARGEST_MASK_PX, Shapes
from perceptree.data.layouts import SPLIT_WORDS
from perceptree.errors import DatasetError

_EXPECTED = "CVAT for images"
_FIRST_BYTES = 4096
_ELLIPSE_CORNERS = 72
_DECLARATION = re.compile(r"<!(DOCTYPE|ENTITY)", re.IGNORECASE)


def cvat_files(folder: Path) -> list[Path]:
    """Return the XML files of CVAT in a folder and one folder below."""
    paths = [path for pattern in ("*.xml", "*/*.xml") for path in sorted(folder.glob(pattern))]
    return [path for path in paths if _begins_as_one(path)]


def _begins_as_one(path: Path) -> bool:
    try:
        with open_regular(path) as file:
            return b"<annotations" in file.read(_FIRST_BYTES)
    except OSError:
        return False


def read_cvat(folder: Path) -> Iterator[tuple[str | None, Path, dict[str, Any], list[str]]]:
    """Yield (split, file, COCO content, notes) of each subset of the folder's files.

    Raises:
        DatasetError: If a file is broken.
    """
    for path in cvat_files(folder) if folder.is_dir() else [folder]:
        splits: dict[str | None, tuple[Shapes, Counter[str]]] = {}
        for image in _root(path).iter("image"):
            split = SPLIT_WORDS.get(image.get("subset", "").lower())
            _read_image(image, path, *splits.setdefault(split, (Shapes(), Counter())))
        for split, (shapes, others) in splits.items():
            content, lost = shapes.content(), shapes.lost_points
            notes = [f"left out: {counted(lost, 'point')} in no tree"] if lost else []
            notes += [f"left out: {counted(count, tag)}" for tag, count in others.items()]
            yield split, path, content, notes


def _root(path: Path) -> ElementTree.Element:
    text = read_text(path, _EXPECTED, LARGEST_LABELS_BYTES)
    if _DECLARATION.search(text):  # entities can grow without limit
        raise DatasetError(f"{path}: declares entities, expected {_EXPECTED}, which has none")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise DatasetError(f"{path}: not readable XML ({error}), expected {_EXPECTED}") from error
    if root.tag != "annotations" or root.find("image") is None:
        raise DatasetError(f"{path}: holds no image, expected {_EXPECTED} (videos: export as such)")
    return root


def _read_image(
    image: ElementTree.Element, path: Path, shapes: Shapes, others: Counter[str]
) -> None:
    name = image.get("name", "")
    wide, high = size(image.get("width"), image.get("height"), path)
    if not name or wide is None or high is None:
        raise DatasetError(f"{path}: an image has no name, width and height, expected all three")
    shapes.add_picture(name, wide, high)
    for place, shape in enumerate(image, start=1):
        what = f"shape {place} of {name}"
        key = ("shape", place)
        if shape.tag == "skeleton":
            _add_skeleton(shape, what, path, shapes, key)
        elif shape.tag == "points":
            group = shape.get("group_id")
            for x, y in _points(shape, what, path):
                shapes.add_point(
                    shape.get("label", ""), x, y, _flag(shape), group and ("group", group)
                )
        elif (region := _region(shape, (wide, high), what, path)) is not None:
            group = shape.get("group_id")
            keys = [key, ("group", group)] if group else [key]
            shapes.add_region(shape.get("label", ""), region, keys)
        elif shape.tag not in ("tag", "attribute"):
            others[shape.tag] += 1


def _add_skeleton(
    skeleton: ElementTree.Element, what: str, path: Path, shapes: Shapes, key: tuple[str, int]
) -> None:
    """Add a skeleton: its points, and a box around them unless a region of its group holds them."""
    group = skeleton.get("group_id")
    own = ("group", group) if group else key
    found = [
        (part.get("label", ""), *_points(part, what, path)[0], _flag(part))
        for part in skeleton.iter("points")
        if part.get("outside", "0") != "1"
    ]
    if not found:
        return
    if not group:
        xs, ys = [one[1] for one in found], [one[2] for one in found]
        box = [min(xs), min(ys), max(xs) - min(xs), max(ys) - min(ys)]
        shapes.add_region(skeleton.get("label", ""), {"bbox": box}, [own])
    for label, x, y, flag in found:
        shapes.add_point(label, x, y, flag, own)


def _flag(shape: ElementTree.Element) -> int:
    return 1 if shape.get("occluded") == "1" else 2


def _points(shape: ElementTree.Element, what: str, path: Path) -> list[tuple[float, float]]:
    pairs = [pair.split(",") for pair in shape.get("points", "").split(";")]
    if not all(len(pair) == 2 for pair in pairs):
        raise DatasetError(f"{path}: the points of {what} are no list of x,y;x,y")
    return [(number(x, path, f"x of {what}"), number(y, path, f"y of {what}")) for x, y in pairs]


def _region(
    shape: ElementTree.Element, picture: tuple[int, int], what: str, path: Path
) -> dict[str, Any] | None:
    """The box or segmentation of a shape; None for other kinds, such as tags."""
    if shape.tag == "box":
        left, top, right, bottom = (
            number(shape.get(name), path, f"{name} of {what}")
            for name in ("xtl", "ytl", "xbr", "ybr")
        )
        if float(turn := number(shape.get("rotation", 0), path, f"rotation of {what}")):
            half = np.array([right - left, bottom - top]) / 2
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
            return _turned(corners, (left + half[0], top + half[1]), turn)
        return {"bbox": [left, top, right - left, bottom - top]}
    if shape.tag == "ellipse":
        x, y, wide, high = (
            number(shape.get(name), path, f"{name} of {what}") for name in ("cx", "cy", "rx", "ry")
        )
        around = np.linspace(0, 2 * np.pi, _ELLIPSE_CORNERS, endpoint=False)
        corners = np.stack([wide * np.cos(around), high * np.sin(around)], -1)
        turn = number(shape.get("rotation", 0), path, f"rotation of {what}")
        return _turned(corners, (x, y), turn)
    if shape.tag in ("polygon", "polyline"):
        points = _points(shape, what, path)
        return {"segmentation": [[value for point in points for value in point]]}
    if shape.tag == "mask":
        return _mask(shape, picture, what, path)
    return None


def _turned(corners: Float64, middle: tuple[float, float], turn_deg: float) -> dict[str, Any]:
    """The polygon of (N, 2) corners around a point, turned clockwise about it."""
    angle = np.deg2rad(turn_deg)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return {"segmentation": [(np.array(middle) + corners @ turn).reshape(-1).tolist()]}


def _mask(
    shape: ElementTree.Element, picture: tuple[int, int], what: str, path: Path
) -> dict[str, Any]:
    """Run lengths of the whole picture from those of a box, which go along its rows."""
    left, top, wide, high = (
        int(number(shape.get(name), path, f"{name} of {what}"))
        for name in ("left", "top", "width", "height")
    )
    runs = numbers(shape.get("rle", "").split(","), path, f"rle of {what}")
    inside = left >= 0 and top >= 0 and left + wide <= picture[0] and top + high <= picture[1]
    inside = inside and wide >= 1 and high >= 1
    fits = min(runs, default=0) >= 0 and sum(runs) == wide * high
    if not (inside and fits) or picture[0] * picture[1] > LARGEST_MASK_PX:
        raise DatasetError(
            f"{path}: the mask of {what} is broken, expected runs that fill its box inside of the"
            " picture"
        )
    values = np.arange(len(runs)) % 2 == 1
    whole = np.zeros((picture[1], picture[0]), np.bool_)
    part = np.repeat(values, np.array(runs, np.int64)).reshape(high, wide)
    whole[top : top + high, left : left + wide] = part
    return {"segmentation": encode_rle(whole), "bbox": [left, top, wide, high]}
