"""Find the image files of a label file."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

import cv2
import numpy as np

from basetree.files.picture_size import file_picture_size
from basetree.files.reading import orientation_note, read_image
from perceptree.data.layouts import SPLIT_WORDS, LabelFile, words

_SAMPLED_IMAGES = 3
_SEPARATORS = re.compile(r"[/\\]")
_MOST_FOLDERS = 8  # at the end of a name
_DEPTH_FIELDS = ("depth_file", "depth8_file")
EXACT_FIELD = "depth_exact_file"


class Pictures:
    """Paths of a dataset's images.

    If the label file names depth images, those are used; otherwise they are searched for by name.
    The search runs once, for a few images. A path or URL that leads out of the dataset's folder
    stands for the file in it that has the same name.

    Attributes:
        notes: Messages for the user about turned images, and depth images found by name.
    """

    def __init__(self, labels: LabelFile, images: list[dict[str, Any]]) -> None:
        step = max(1, len(images) // _SAMPLED_IMAGES)
        sampled = [image for image in images[::step] if isinstance(image.get("file_name"), str)]
        names = [image["file_name"] for image in sampled]
        self._root = labels.root
        self._top = os.path.abspath(labels.root)
        self._labels = labels
        self._path_of = _find_path_rule(labels, names)
        self._depth8: _DepthRule | None = None
        there = [path for name in names if os.path.isfile(path := self._path_of(name))]
        self.notes: tuple[str, ...] = _orientation_notes(there)
        if not any(image.get(field) for image in sampled for field in _DEPTH_FIELDS):
            self._find_depth(there)

    @cached_property
    def _places(self) -> list[Path]:
        return list(_folders(self._labels))

    def find(self, name: str, field: str = "file_name") -> Path | None:
        """Return the path of an image or depth image; None if it is not in the dataset's folder.

        Links inside of the folder may lead out of it: whoever made them can read the target.

        Args:
            name: Its name in the label file.
            field: The field with the name.
        """
        path = self._path_of(name) if field == "file_name" else self._root / name
        if not (".." in name or os.path.isabs(name)) or self._is_inside(path):
            return path
        last = path_parts(name)[-1:]
        paths = (folder.joinpath(*last) for folder in self._places) if last else ()
        return next((path for path in paths if os.path.isfile(path)), None)

    def _is_inside(self, path: Path) -> bool:
        return Path(os.path.abspath(path)).is_relative_to(self._top)

    def of(self, image: dict[str, Any]) -> tuple[Path, Path | None, Path | None]:
        """Return the paths of an image's colour, 16-bit depth and 8-bit depth; None if missing.

        `find` must know all names of the image.
        """
        colour = self.find(image["file_name"])
        if colour is None:
            raise LookupError(image["file_name"])
        if self._depth8 is not None:
            return colour, None, self._depth8(colour)
        depth, depth8 = (
            None if image.get(field) is None else self.find(image[field], field)
            for field in _DEPTH_FIELDS
        )
        return colour, depth, depth8

    def exact(self, image: dict[str, Any]) -> Path | None:
        """Return the path of an image's exact depth, which simulated frames have."""
        name = image.get(EXACT_FIELD)
        return None if name is None else self.find(name, EXACT_FIELD)

    def give_size(self, image: dict[str, Any]) -> bool:
        """Give an image the size that its file's header states; return whether there is one."""
        path = self.find(image["file_name"])
        size = None if path is None else file_picture_size(path)
        if size is not None:
            image["width"], image["height"] = size
        return size is not None

    def _find_depth(self, pictures: list[Path]) -> None:
        for rule in _depth_rules(self._root) if pictures else ():
            if all((found := rule(path)) != path and os.path.isfile(found) for path in pictures):
                first = rule(pictures[0])
                image = read_image(first, cv2.IMREAD_UNCHANGED)
                if image is not None and image.dtype == np.uint8 and image.ndim == 2:
                    self._depth8 = rule
                    self.notes += (
                        f"depth images found, such as {first.relative_to(self._root.parent)}; their"
                        " depth encoding is unknown: the grey values are used unchanged",
                    )
                else:
                    self.notes += (
                        f"depth is left out: {first.relative_to(self._root.parent)} is not an 8-bit"
                        " single-channel image",
                    )
                return


def _orientation_notes(pictures: list[Path]) -> tuple[str, ...]:
    """Say how pictures are turned if one of these states an EXIF orientation."""
    stated = ((path, orientation_note(path)) for path in pictures)
    path, note = next(((path, note) for path, note in stated if note), (None, ""))
    if path is None:
        return ()
    return (
        f"{path.name} is{note}: pictures are read as stored if that has the labels' size, else"
        " turned; perceptree data check counts them",
    )


@dataclass(frozen=True)
class _PathRule:
    """Converts an image's name to a path in `folder`.

    Attributes:
        folder: Where the path starts.
        dropped: How many folders at the start of the name are left out, of a path of any system or
            a URL; -1 for all, None for a name as it is.
    """

    folder: Path
    dropped: int | None = None

    def __call__(self, name: str) -> Path:
        if self.dropped is None:
            return _as_named(self.folder / name)
        parts = path_parts(name)
        return _as_named(self.folder.joinpath(*(parts[self.dropped :] or parts[-1:])))


def _as_named(path: Path) -> Path:
    """The path, or the file whose name has its letters composed otherwise or no percent signs.

    Systems compose letters with marks differently, and tools write spaces as in addresses.
    """
    name = path.name
    if (name.isascii() and "%" not in name) or os.path.isfile(path):
        return path
    others = (*(unicodedata.normalize(form, name) for form in ("NFC", "NFD")), unquote(name))
    paths = (path.with_name(other) for other in others if not _SEPARATORS.search(other))
    return next((other for other in paths if os.path.isfile(other)), path)


def path_parts(name: str) -> list[str]:
    """Split a path of any system, or a URL, into folders and file name.

    Examples:
        >>> path_parts("C:\\\\trees\\\\a.jpg"), path_parts("/data/local-files/?d=trees/a%201.jpg")
        (['C:', 'trees', 'a.jpg'], ['trees', 'a 1.jpg'])
    """
    path, question, query = name.partition("?")
    if question and not PurePosixPath(path).suffix:
        path = query.rpartition("=")[2]
    if question or "://" in name:
        path = unquote(path)
    return [part for part in _SEPARATORS.split(path) if part.strip(".") and "\0" not in part]


def _find_path_rule(labels: LabelFile, names: list[str]) -> _PathRule:
    """Return the first rule that finds one of the named images: it drops as little as possible."""
    rules = (_PathRule(folder) for folder in _folders(labels))
    if (found := _first_that_finds(rules, names)) is not None:
        return found
    folders = list(_folders(labels))
    depth = min((len(path_parts(name)) for name in names), default=0)
    drops = [*range(max(0, depth - _MOST_FOLDERS), depth), -1]
    rules = (_PathRule(folder, dropped) for dropped in drops for folder in folders)
    return _first_that_finds(rules, names) or _PathRule(labels.root)


def _first_that_finds(rules: Iterable[_PathRule], names: list[str]) -> _PathRule | None:
    return next((rule for rule in rules if any(os.path.isfile(rule(name)) for name in names)), None)


def _folders(labels: LabelFile) -> Iterator[Path]:
    """Yield folders that may hold the images, most likely first; never another split's."""
    beside = labels.path.parent
    yield from (labels.root, beside) if beside.name == "annotations" else (beside, labels.root)
    own: list[Path] = []
    other: list[Path] = []
    for pattern in ("*/", "*/*/"):
        for folder in sorted(labels.root.glob(pattern)):
            name = words(folder.relative_to(labels.root).as_posix())
            splits = {SPLIT_WORDS[word] for word in name if word in SPLIT_WORDS}
            if not any("depth" in word for word in name) and splits <= {labels.split}:
                (own if splits else other).append(folder)
    yield from own
    yield from other


@dataclass(frozen=True)
class _DepthRule:
    """Converts an image's path to that of its depth image.

    Attributes:
        folder: Folder of the depth images; None for the image's own.
        nested: Whether the depth image is in a subfolder named like the image's folder.
        pattern: Regular expression replaced in the file name.
        word: Its replacement.
        png: Whether the depth image is a PNG whatever the image is.
    """

    folder: Path | None
    nested: bool
    pattern: str
    word: str
    png: bool

    def __call__(self, path: Path) -> Path:
        stem = re.sub(self.pattern, self.word, path.stem, flags=re.IGNORECASE)
        name = stem + (".png" if self.png else path.suffix)
        if self.folder is None:
            return path.with_name(name)
        return self.folder / path.parent.name / name if self.nested else self.folder / name


def _depth_rules(root: Path) -> Iterator[_DepthRule]:
    """Yield rules to try: folders named like depth, file names with "depth" in them."""
    candidates = [(None, False)] + [
        (folder, nested)
        for parent, called in ((root, "depth"), (root.parent, f"{root.name.lower()}_depth"))
        for folder in sorted(parent.glob("*/"))
        if called in folder.name.lower()
        for nested in (False, True)
    ]
    renames = (("^$", ""), ("rgb", "depth"), ("rgb", "Depth"), ("$", "_depth"))
    for (pattern, word), png, (folder, nested) in product(renames, (False, True), candidates):
        yield _DepthRule(folder, nested, pattern, word, png)
