"""Read the labels of YOLO trainers: a text file for each picture, and `data.yaml`.

A line is a class and numbers as shares of the picture's size: a box by its middle (4 numbers), a
polygon (6 and more), or a box and keypoints, whose number and size `kpt_shape` states.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from basetree.files.headers.exif import UPRIGHT
from basetree.files.picture_size import checked_header, most_picture_bytes
from basetree.files.reading import is_image_file, read_text
from basetree.files.regular import read_regular
from calib.files.yaml_text import parse_yaml
from perceptree.data.coco import SPLITS
from perceptree.data.exchange.fields import number
from perceptree.data.exchange.shapes import Shapes
from perceptree.data.layouts import SPLIT_WORDS, words
from perceptree.errors import DatasetError
from perceptree.keypoints import KEYPOINT_NAMES

SETTINGS_NAMES = ("data.yaml", "dataset.yaml", "data.yml", "dataset.yml")
FOLDER_OF_NONE = "all"
"""Folder of the pictures of a set without splits, as `write_yolo` names it."""
_NAMES_FILES = ("classes.txt", "obj.names")
_TURNED_BY_A_QUARTER = 5  # and more: EXIF orientations that change width and height
_VISIBLE = 2
# Coordinates are shares from 0 to 1; some trainers write a little more at the border.
_SHARES = (-1.0, 2.0)


@dataclass(frozen=True)
class YoloSettings:
    """What `data.yaml` states.

    Attributes:
        names: Names of the classes, by number.
        keypoints: Number of keypoints, and numbers of each: 2 or 3.
        keypoint_names: Names of the keypoints.
        splits: Folder or list of pictures of each split.
    """

    names: dict[int, str] = field(default_factory=dict)
    keypoints: tuple[int, int] = (0, 0)
    keypoint_names: tuple[str, ...] = ()
    splits: dict[str | None, list[Path]] = field(default_factory=dict)


def settings_file(folder: Path) -> Path | None:
    """Return the file with the settings of a YOLO dataset, None if there is none."""
    return next((path for name in SETTINGS_NAMES if (path := folder / name).is_file()), None)


def is_yolo(folder: Path) -> bool:
    """Whether a folder holds labels of YOLO trainers."""
    return folder.is_dir() and (
        settings_file(folder) is not None
        or ((folder / "labels").is_dir() and any((folder / "labels").glob("**/*.txt")))
    )


def read_yolo(folder: Path) -> Iterator[tuple[str | None, Path, dict[str, Any], list[str]]]:
    """Yield (split, label file, COCO content, notes) of each split of a YOLO dataset.

    Raises:
        DatasetError: If a file is missing or broken.
        InputFileError: If a text cannot be read.
    """
    folder = folder.resolve()  # as the places that settings name are
    path = settings_file(folder)
    settings = _read_settings(path) if path else _guess_settings(folder)
    if not settings.splits:
        where = path or folder
        raise DatasetError(f"{where}: names no folder of pictures, expected train, val or test")
    for split, places in settings.splits.items():
        shapes, without = Shapes(), 0
        for picture in _pictures(places):
            without += not _read_picture(picture, folder, settings, shapes)
        notes = [f"{without} pictures have no label file: no trees"] if without else []
        yield split, path or folder / "labels", shapes.content(), notes


def _read_settings(path: Path) -> YoloSettings:
    expected = "settings of a YOLO dataset"
    try:
        content = parse_yaml(read_text(path, expected))
    except (ValueError, RecursionError) as error:
        first = str(error).splitlines()[0]
        raise DatasetError(f"{path}: not readable YAML ({first}), expected {expected}") from error
    settings = content[0] if content else None
    if not isinstance(settings, dict):
        raise DatasetError(f"{path}: expected {expected}: names, train, val")
    count, each = _keypoint_shape(settings.get("kpt_shape"), path)
    return YoloSettings(
        _names(settings.get("names"), path),
        (count, each),
        _keypoint_names(settings.get("kpt_names"), count),
        _splits(settings, path),
    )


def _names(names: Any, path: Path) -> dict[int, str]:
    if isinstance(names, list):
        names = dict(enumerate(names))
    if names is None:
        return {}
    if not isinstance(names, dict) or not all(str(key).isdecimal() for key in names):
        raise DatasetError(f"{path}: names is {str(names)[:60]!r}, expected names of the classes")
    return {int(str(key)): str(name) for key, name in names.items()}


def _keypoint_shape(shape: Any, path: Path) -> tuple[int, int]:
    if shape is None:
        return 0, 0
    fits = isinstance(shape, list) and len(shape) == 2 and str(shape[0]).isdecimal()
    if not fits or str(shape[1]) not in ("2", "3") or not 1 <= int(shape[0]) <= 1000:
        raise DatasetError(
            f"{path}: kpt_shape is {str(shape)[:60]}, expected the number of keypoints and 2 or 3"
        )
    return int(shape[0]), int(shape[1])


def _keypoint_names(names: Any, count: int) -> tuple[str, ...]:
    """The names of the first class's keypoints; five without names are this project's."""
    if isinstance(names, dict):
        names = next(iter(names.values()), None)
    if isinstance(names, list) and len(names) == count:
        return tuple(map(str, names))
    if count == len(KEYPOINT_NAMES):
        return KEYPOINT_NAMES
    return tuple(f"keypoint {place + 1}" for place in range(count))


def _splits(settings: dict[str, Any], path: Path) -> dict[str | None, list[Path]]:
    found: dict[str | None, list[Path]] = {}
    top = settings.get("path") if isinstance(settings.get("path"), str) else ""
    for key, value in settings.items():
        listed = value if isinstance(value, list) else [value]
        if key not in SPLIT_WORDS or not value or not all(isinstance(one, str) for one in listed):
            continue
        found[SPLIT_WORDS[key]] = [_place(one, str(top), key, path) for one in listed]
    # Trainers demand train and val, so sets without them name other pictures twice.
    others = [places for split, places in found.items() if split != "val"]
    if found.get("val") in others:
        del found["val"]
        if list(found) == ["train"] and found["train"][0].name == FOLDER_OF_NONE:
            return {None: found["train"]}
    return {split: found[split] for split in SPLITS if split in found}


def _place(name: str, top: str, key: str, path: Path) -> Path:
    """The folder or list of pictures that a setting names; always below the settings' folder.

    Exports write places of another machine, or `../train/images` for a folder beside the file.
    """
    root = path.parent.resolve()
    parts = [part for part in Path(name).parts if part not in ("..", ".", "/")]
    tops = [Path(top), Path()] if top and not Path(top).is_absolute() else [Path()]
    for start in tops:
        for first in range(len(parts)):
            found = root.joinpath(start, *parts[first:])
            if found.exists() and found.resolve().is_relative_to(root):
                return found
    raise DatasetError(f"{path}: {key} is {name!r}, expected a folder of pictures beside the file")


def _guess_settings(folder: Path) -> YoloSettings:
    """Settings of a folder with `images` and `labels` alone; `classes.txt` names the classes."""
    names = {}
    for name in _NAMES_FILES:
        if (folder / name).is_file():
            lines = read_text(folder / name, "names of classes").splitlines()
            names = dict(enumerate(line.strip() for line in lines if line.strip()))
    images = folder / "images"
    place = images if images.is_dir() else folder
    inside = {child.name.lower(): child for child in place.iterdir() if child.is_dir()}
    splits: dict[str | None, list[Path]] = {
        SPLIT_WORDS[name]: [inside[name]] for name in inside if name in SPLIT_WORDS
    } or {None: [place]}
    return YoloSettings(names=names, splits=splits)


def _pictures(places: list[Path]) -> Iterator[Path]:
    for place in places:
        if place.is_dir():
            yield from (path for path in sorted(place.rglob("*")) if is_image_file(path))
            continue
        for line in read_text(place, "a list of pictures", 2**28).splitlines():
            if line.strip():
                yield _listed_picture(line.strip(), place)


def _listed_picture(line: str, place: Path) -> Path:
    """A picture that a list names; its path may begin on another machine."""
    parts = [part for part in Path(line).parts if part not in ("..", ".", "/")]
    paths = (place.parent.joinpath(*parts[first:]) for first in range(len(parts)))
    found = next((path for path in paths if path.is_file()), None)
    if found is None:
        raise DatasetError(f"{place}: {line[:200]} is not beside the list, expected a picture")
    return found


def _read_picture(picture: Path, folder: Path, settings: YoloSettings, shapes: Shapes) -> bool:
    """Add a picture and its labels; return whether it has a label file."""
    width, height = _upright_size(picture)
    shapes.add_picture(picture.relative_to(folder).as_posix(), width, height)
    labels = _labels_of(picture)
    if labels is None:
        return False
    text = read_text(labels, "a line for each tree", 2**26)
    for place, line in enumerate(text.splitlines(), start=1):
        if line.strip():
            _add_line(line.split(), (width, height), settings, shapes, (labels, place))
    return True


def _upright_size(path: Path) -> tuple[int, int]:
    """Width and height of a picture, turned as EXIF says: so YOLO trainers read them."""
    try:
        header = checked_header(read_regular(path, most_picture_bytes()), str(path))
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror})") from error
    if header is None:
        raise DatasetError(f"{path}: the size of the picture cannot be read")
    if header.orientation != UPRIGHT and header.orientation >= _TURNED_BY_A_QUARTER:
        return header.height, header.width
    return header.width, header.height


def _labels_of(picture: Path) -> Path | None:
    """The label file of a picture: in the folder `labels` for `images`, or beside it."""
    parts = list(picture.parts)
    candidates = [picture.with_suffix(".txt")]
    for place in range(len(parts) - 2, -1, -1):
        if words(parts[place])[:1] == ["images"]:
            candidates.insert(0, Path(*parts[:place], "labels", *parts[place + 1 :]))
            break
    paths = (path.with_suffix(".txt") for path in candidates)
    return next((path for path in paths if path.is_file()), None)


def _class_name(value: float, names: dict[int, str], where: tuple[Path, int]) -> str:
    """The name of a class; without names all are trees."""
    if not names:
        return "tree"
    if value not in names:
        raise DatasetError(
            f"{where[0]}: line {where[1]} is of class {value:g}, expected the number of one of"
            f" names, {min(names)} to {max(names)}"
        )
    return names[int(value)]


def _flag(value: float, labels: Path, place: int) -> int:
    if value not in (0, 1, _VISIBLE):
        raise DatasetError(
            f"{labels}: line {place} has the visibility {value:g}, expected 0, 1 or 2 as labels"
            " have it; networks write shares"
        )
    return int(value)


def _add_line(
    line: list[str],
    size: tuple[int, int],
    settings: YoloSettings,
    shapes: Shapes,
    where: tuple[Path, int],
) -> None:
    labels, place = where
    what = f"a number in line {place}"
    values = [number(value, labels, what) for value in line]
    label = _class_name(values[0], settings.names, where)
    shares, (count, each) = values[1:], settings.keypoints
    keys = [place]
    is_box = len(shares) == 4 or bool(count and len(shares) == 4 + count * each)
    points = [shares[start : start + 2] for start in range(4, len(shares), max(each, 2))]
    for share in [*shares[:4], *itertools.chain(*points)] if is_box else shares:
        if not _SHARES[0] <= share <= _SHARES[1]:
            raise DatasetError(
                f"{labels}: line {place} has the coordinate {share:g}, expected shares of the"
                " picture's size, 0 to 1"
            )
    if is_box:
        x, y, wide, high = (share * size[axis % 2] for axis, share in enumerate(shares[:4]))
        shapes.add_region(label, {"bbox": [x - wide / 2, y - high / 2, wide, high]}, keys)
        for index, name in enumerate(settings.keypoint_names if len(shares) > 4 else ()):
            at = shares[4 + index * each : 4 + (index + 1) * each]
            flag = _flag(at[2], labels, place) if each == 3 else _VISIBLE * any(at)
            if flag:
                shapes.add_point(name, at[0] * size[0], at[1] * size[1], flag, place)
    elif len(shares) >= 6 and len(shares) % 2 == 0:
        polygon = [share * size[axis % 2] for axis, share in enumerate(shares)]
        shapes.add_region(label, {"segmentation": [polygon]}, keys)
    else:
        raise DatasetError(
            f"{labels}: line {place} has {len(line)} numbers, expected a class and a box (4), a"
            f" polygon (6, 8, ...) or a box with the keypoints of kpt_shape"
        )
