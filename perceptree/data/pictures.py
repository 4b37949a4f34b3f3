"""Where the pictures of a label file are: found once, on its first images."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from perceptree.data.layouts import SPLIT_WORDS, LabelFile, words

_LOOKED_AT = 3
_FOLDERS = re.compile(r"[/\\]")
_DEPTH_FIELDS = ("depth_file", "depth8_file")


class Pictures:
    """Paths of a set's pictures; ``notes`` says where depth was found without a word of the labels.

    A set whose images name depth files is taken at its word; for any other, depth pictures are
    looked for by their names.
    """

    def __init__(self, labels: LabelFile, images: list[dict[str, Any]]) -> None:
        step = max(1, len(images) // _LOOKED_AT)
        looked_at = [image for image in images[::step] if isinstance(image.get("file_name"), str)]
        names = [image["file_name"] for image in looked_at]
        self._root = labels.root
        self._place = _place_rule(labels, names)
        self._depth8: _DepthRule | None = None
        self.notes: tuple[str, ...] = ()
        if not any(image.get(field) for image in looked_at for field in _DEPTH_FIELDS):
            self._find_depth([path for name in names if (path := self._place(name)).is_file()])

    def of(self, image: dict[str, Any]) -> tuple[Path, Path | None, Path | None]:
        """An image's colour, 16-bit depth and 8-bit depth; None for what the set does not have."""
        colour = self._place(image["file_name"])
        if self._depth8 is not None:
            return colour, None, self._depth8(colour)
        depth, depth8 = (
            None if image.get(field) is None else self._root / image[field]
            for field in _DEPTH_FIELDS
        )
        return colour, depth, depth8

    def _find_depth(self, pictures: list[Path]) -> None:
        for rule in _depth_rules(self._root) if pictures else ():
            if all((found := rule(path)) != path and found.is_file() for path in pictures):
                first = rule(pictures[0])
                image = cv2.imread(str(first), cv2.IMREAD_UNCHANGED)
                if image is not None and image.dtype == np.uint8 and image.ndim == 2:
                    self._depth8 = rule
                    self.notes = (
                        f"depth pictures found like {first.relative_to(self._root.parent)}; nothing"
                        " says which grey is how many metres: they are taken as they are",
                    )
                else:
                    self.notes = (
                        f"depth is left out: {first.relative_to(self._root.parent)} is not an 8-bit"
                        " picture of one channel",
                    )
                return


@dataclass(frozen=True)
class _Place:
    """How picture names become paths: within a folder, the names' own folders kept or not."""

    folder: Path
    flat: bool = False

    def __call__(self, name: str) -> Path:
        return self.folder / (_FOLDERS.split(name)[-1] if self.flat else name)


def _place_rule(labels: LabelFile, names: list[str]) -> _Place:
    """The first place that holds one of the named pictures."""
    for flat in (False, True):
        for folder in _folders(labels):
            place = _Place(folder, flat)
            if any(place(name).is_file() for name in names):
                return place
    return _Place(labels.root)


def _folders(labels: LabelFile) -> Iterator[Path]:
    """Folders in which a set may keep its pictures, the likely first; never another split's."""
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
    """How a picture's path becomes that of its depth picture.

    It lies in ``folder`` (None: beside the picture), there in a folder named like the picture's
    where ``nested``; ``pattern`` in its name becomes ``word``; ``png`` where the picture is not.
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
    """Ways from a picture to its depth picture: a folder called like depth, a name that says so."""
    places = [(None, False)] + [
        (folder, nested)
        for place, called in ((root, "depth"), (root.parent, f"{root.name.lower()}_depth"))
        for folder in sorted(place.glob("*/"))
        if called in folder.name.lower()
        for nested in (False, True)
    ]
    renames = (("^$", ""), ("rgb", "depth"), ("rgb", "Depth"), ("$", "_depth"))
    for (pattern, word), png, (folder, nested) in product(renames, (False, True), places):
        yield _DepthRule(folder, nested, pattern, word, png)
