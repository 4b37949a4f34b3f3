"""Find the image files of a label file."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from basetree.files.reading import read_image
from perceptree.data.layouts import SPLIT_WORDS, LabelFile, words

_SAMPLED_IMAGES = 3
_FOLDERS = re.compile(r"[/\\]")
_DEPTH_FIELDS = ("depth_file", "depth8_file")


class Pictures:
    """Paths of a dataset's images.

    If the label file names depth images, those are used; otherwise they are searched for by name.
    The search runs once, for a few images.

    Attributes:
        notes: Messages for the user about depth images found by name.
    """

    def __init__(self, labels: LabelFile, images: list[dict[str, Any]]) -> None:
        step = max(1, len(images) // _SAMPLED_IMAGES)
        sampled = [image for image in images[::step] if isinstance(image.get("file_name"), str)]
        names = [image["file_name"] for image in sampled]
        self._root = labels.root
        self._path_of = _find_path_rule(labels, names)
        self._depth8: _DepthRule | None = None
        self.notes: tuple[str, ...] = ()
        if not any(image.get(field) for image in sampled for field in _DEPTH_FIELDS):
            self._find_depth(
                [path for name in names if os.path.isfile(path := self._path_of(name))]
            )

    def is_inside(self, name: str) -> bool:
        """Whether an image or depth image of this name is in the dataset's folder.

        Links inside of the folder may lead out of it: whoever made them can read the target.
        """
        if ".." not in name and not os.path.isabs(name):
            return True
        root = os.path.abspath(self._root)
        paths = (self._path_of(name), self._root / name)
        return all(Path(os.path.abspath(path)).is_relative_to(root) for path in paths)

    def of(self, image: dict[str, Any]) -> tuple[Path, Path | None, Path | None]:
        """Return the paths of an image's colour, 16-bit depth and 8-bit depth; None if missing."""
        colour = self._path_of(image["file_name"])
        if self._depth8 is not None:
            return colour, None, self._depth8(colour)
        depth, depth8 = (
            None if image.get(field) is None else self._root / image[field]
            for field in _DEPTH_FIELDS
        )
        return colour, depth, depth8

    def _find_depth(self, pictures: list[Path]) -> None:
        for rule in _depth_rules(self._root) if pictures else ():
            if all((found := rule(path)) != path and os.path.isfile(found) for path in pictures):
                first = rule(pictures[0])
                image = read_image(first, cv2.IMREAD_UNCHANGED)
                if image is not None and image.dtype == np.uint8 and image.ndim == 2:
                    self._depth8 = rule
                    self.notes = (
                        f"depth images found, such as {first.relative_to(self._root.parent)}; their"
                        " depth encoding is unknown: the grey values are used unchanged",
                    )
                else:
                    self.notes = (
                        f"depth is left out: {first.relative_to(self._root.parent)} is not an 8-bit"
                        " single-channel image",
                    )
                return


@dataclass(frozen=True)
class _PathRule:
    """Converts an image's name to a path in `folder`; `flat` drops folders in the name."""

    folder: Path
    flat: bool = False

    def __call__(self, name: str) -> Path:
        return self.folder / (_FOLDERS.split(name)[-1] if self.flat else name)


def _find_path_rule(labels: LabelFile, names: list[str]) -> _PathRule:
    """Return the first rule that finds one of the named images."""
    for flat in (False, True):
        for folder in _folders(labels):
            rule = _PathRule(folder, flat)
            if any(os.path.isfile(rule(name)) for name in names):
                return rule
    return _PathRule(labels.root)


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
