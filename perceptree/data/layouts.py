"""Where datasets keep their files: labels by split and fold, pictures, depth pictures.

Label files that are found by their names, within a dataset's folder or one folder below:

=============================================  =================================================
``train_RGB.json``                             the simulator; SynthTree43k as published
``train_RGB_entire_tree.json``                 SynthTree43k's labels of entire trees
``annotations/trees_train.json``               SynthTree43k and CanaTree100 as later users keep them
``fold_01/train_RGB.json``, ``train_1.json``   folds, by folder or by number
``annotations/instances_train2017.json``       COCO, CVAT (there also ``instances_default.json``)
``train/_annotations.coco.json``               Roboflow, where ``valid`` is val
=============================================  =================================================

What is published of the authors' sets, in the README and ``train_synth_RGB.py`` of
norlab-ulaval/PercepTreeV1: SynthTree43k is one folder of 1280x720 pictures named like
``image_00000_RGB.png`` with ``train_RGB.json``, ``val_RGB.json`` and ``test_RGB.json``; masks are
compressed runs, the one category is ``tree``, its five keypoints are kpCP, kpL, kpR, AX1, AX2. The
depth pictures (8-bit, one channel) are an archive of their own, and so are three files
``*_RGB_entire_tree.json`` for the same pictures. CanaTree100 has train, val and test for each of
five folds; its models are named ``fold_01``. The archives themselves could not be looked into, so
names are recognised by their words and not by one fixed pattern, and a depth picture is one of the
same name in a folder called like depth, or one whose name says depth where the other says RGB.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from perceptree.data.coco import SPLITS
from perceptree.errors import DatasetError

SPLIT_WORDS = {
    "train": "train",
    "training": "train",
    "val": "val",
    "valid": "val",
    "validation": "val",
    "test": "test",
    "testing": "test",
}
_NOT_LABELS = frozenset(
    (
        "captions",
        "panoptic",
        "stuff",
        "info",
        "results",
        "result",
        "predictions",
        "detections",
        "settings",
        "statistics",
        "metrics",
        "report",
        "log",
    )
)
# Files that name no split themselves: their folder does, or the set is one for looking and testing.
_PLAIN_STEMS = frozenset(
    ("_annotations.coco", "annotations", "instances", "instances_default", "labels", "coco")
)
_NAMED = 8


@dataclass(frozen=True, order=True)
class LabelFile:
    """A label file: of which split and fold, whether of entire trees, and the set's folder."""

    split: str
    fold: int | None
    entire_tree: bool
    path: Path
    root: Path


def label_files(directory: Path) -> list[LabelFile]:
    """All label files of a dataset's folder, those it holds and those one folder below."""
    found = [
        LabelFile(*recognised, path, directory)
        for pattern in ("*.json", "*/*.json", "fold*/annotations/*.json")
        for path in sorted(directory.glob(pattern))
        if (recognised := _recognise(path.relative_to(directory))) is not None
    ]
    # Depth has the same labels as colour, where both have files.
    colour = [file for file in found if "depth" not in file.path.stem.lower()]
    return sorted(colour or found, key=lambda file: (file.split, file.fold or 0, file.path))


def _recognise(path: Path) -> tuple[str, int | None, bool] | None:
    """(split, fold, entire tree) as a label file's name and folders say; None for other files."""
    stem = words(path.stem)
    if _NOT_LABELS & set(stem):
        return None
    splits = [SPLIT_WORDS[word] for word in stem if word in SPLIT_WORDS]
    if not splits and path.stem in _PLAIN_STEMS:
        folders = words(path.parent.as_posix())
        splits = [SPLIT_WORDS[word] for word in folders if word in SPLIT_WORDS] or ["test"]
    if len(set(splits)) != 1:
        return None
    fold = _fold(words(path.parent.as_posix()), after_split=False)
    if fold is None:
        fold = _fold(stem, after_split=True)
    return splits[0], fold, "entire" in stem


def words(name: str) -> list[str]:
    """The words and numbers of a name, in lower case."""
    return re.findall(r"[a-z]+|[0-9]+", name.lower())


def _fold(name: list[str], after_split: bool) -> int | None:
    """The number after the word fold, or the last of one or two digits after the split's word."""
    for word, following in pairwise(name):
        if word == "fold" and following.isdigit():
            return int(following)
    ends = after_split and name[-1].isdigit() and len(name[-1]) <= 2
    return int(name[-1]) if ends and SPLIT_WORDS.keys() & set(name[:-1]) else None


def find_labels(
    directory: Path, split: str, fold: int | None = None, entire_tree: bool = False
) -> LabelFile:
    """The one label file of a split. ``directory`` may be a label file itself.

    Raises DatasetError, in one line that says what there is, where none or several fit.
    """
    if directory.is_file():
        return _single(directory, split)
    files = label_files(directory)
    named = _nearest(
        [file for file in files if file.split == split and file.entire_tree == entire_tree]
    )
    fitting = [file for file in named if file.fold == fold]
    folds = sorted({file.fold for file in named if file.fold is not None})
    if fold is None and not fitting and folds:
        if len(folds) > 1:
            listed = ", ".join(map(str, folds))
            raise DatasetError(f"{directory}: holds folds {listed}, expected one: --fold NUMBER")
        fitting = named
    if not fitting:
        raise DatasetError(_nothing_fits(directory, split, fold, entire_tree, files))
    colour = [file for file in fitting if "rgb" in words(file.path.stem)]
    fitting = colour if len(colour) == 1 else fitting
    if len(fitting) > 1:
        listed = _listed(directory, fitting)
        raise DatasetError(
            f"{directory}: holds several label files for {split}: {listed}, expected one"
        )
    return fitting[0]


def _nearest(files: list[LabelFile]) -> list[LabelFile]:
    """Those in the set's folder itself; else in one named for labels; else in any below."""

    def distance(file: LabelFile) -> int:
        folders = words(file.path.parent.relative_to(file.root).as_posix())
        known = SPLIT_WORDS.keys() | {"fold", "annotations", "labels"}
        return 0 if not folders else 1 if known & set(folders) else 2

    least = min(map(distance, files), default=0)
    return [file for file in files if distance(file) == least]


def find_splits(
    directory: Path, fold: int | None = None, entire_tree: bool = False
) -> list[LabelFile]:
    """The label files of all splits that a dataset has, train, val, test, as `find_labels` does."""
    if directory.is_file():
        return [_single(directory, None)]
    files = label_files(directory)
    there = {file.split for file in files if file.entire_tree == entire_tree}
    wanted = [split for split in SPLITS if split in there] or ["train"]
    return [find_labels(directory, split, fold, entire_tree) for split in wanted]


def _nothing_fits(
    directory: Path, split: str, fold: int | None, entire_tree: bool, files: list[LabelFile]
) -> str:
    name = f"{split}_RGB{'_entire_tree' * entire_tree}.json"
    if not files:
        return (
            f"{directory / name}: no such file, expected a dataset with {name},"
            f" annotations/instances_{split}*.json or {split}/_annotations.coco.json"
        )
    wanted = f"{'entire-tree ' * entire_tree}labels of {split}"
    wanted += "" if fold is None else f" in fold {fold}"
    hint = ""
    if not entire_tree and any(file.entire_tree and file.split == split for file in files):
        hint = "; --entire-tree chooses labels of entire trees"
    return f"{directory}: expected {wanted}, say {name}; found {_listed(directory, files)}{hint}"


def _listed(directory: Path, files: list[LabelFile]) -> str:
    names = [file.path.relative_to(directory).as_posix() for file in files]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def _single(path: Path, split: str | None) -> LabelFile:
    """A label file that was named itself; where its name says no split, it is one for testing."""
    recognised = _recognise(Path(path.name))
    named = recognised[0] if recognised else "test"
    if split not in (None, named):
        raise DatasetError(
            f"{path}: one label file of {named}, expected a dataset's folder to read {split}"
        )
    root = path.parent.parent if path.parent.name == "annotations" else path.parent
    return LabelFile(named, None, False, path, root)
