"""Find the label files of a dataset.

Label files are recognised by their names, in a dataset's folder or one folder below:

=============================================  =================================================
`train_RGB.json`                             the simulator; SynthTree43k as published
`train_RGB_entire_tree.json`                 SynthTree43k's labels of entire trees
`annotations/trees_train.json`               common repackagings of SynthTree43k, CanaTree100
`fold_01/train_RGB.json`, `train_1.json`   folds, by folder or by number
`annotations/instances_train2017.json`       COCO, CVAT
`annotations/instances_default.json`         CVAT
`train/_annotations.coco.json`               Roboflow, which calls val `valid`
=============================================  =================================================

The README and `train_synth_RGB.py` of norlab-ulaval/PercepTreeV1 describe the published data.
SynthTree43k is one folder of 1280x720 images named like `image_00000_RGB.png` with
`train_RGB.json`, `val_RGB.json` and `test_RGB.json`. Masks are compressed run lengths, the
only category is `tree`, and its keypoints are kpCP, kpL, kpR, AX1, AX2. The depth images (8-bit,
one channel) and the three `*_RGB_entire_tree.json` files come as separate archives. CanaTree100
has train, val and test for each of five folds; its models are named `fold_01`.

The archives' own contents were not available, so file names are matched by the words in them rather
than by one fixed pattern. Depth images are found by name: in a folder whose name contains "depth",
or with "depth" in place of "RGB" in the file name.
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
_NOT_LABELS = re.compile(
    "captions|panoptic|stuff|info|results?|predictions|detections|settings|statistics|metrics"
    "|report|log"
)
# Names without a split: the folder's name gives the split, else it is "test".
_PLAIN_STEMS = frozenset(
    ("_annotations.coco", "annotations", "instances", "instances_default", "labels", "coco")
)
_MAX_LISTED = 8


@dataclass(frozen=True, order=True)
class LabelFile:
    """A label file.

    Attributes:
        split: "train", "val" or "test".
        fold: Number of the fold, if any.
        entire_tree: Whether the labels are of entire trees.
        path: The file.
        root: The dataset's folder.
    """

    split: str
    fold: int | None
    entire_tree: bool
    path: Path
    root: Path


def label_files(directory: Path) -> list[LabelFile]:
    """Return all label files in a dataset's folder and one folder below."""
    found = [
        LabelFile(*recognised, path, directory)
        for pattern in ("*.json", "*/*.json", "fold*/annotations/*.json")
        for path in sorted(directory.glob(pattern))
        if (recognised := _recognise(path.relative_to(directory))) is not None
    ]
    # If there are label files for colour and depth, they are the same: use those for colour.
    colour = [file for file in found if "depth" not in file.path.stem.lower()]
    return sorted(colour or found, key=lambda file: (file.split, file.fold or 0, file.path))


def _recognise(path: Path) -> tuple[str, int | None, bool] | None:
    """Return (split, fold, entire tree) from a file's name and folders; None for other files."""
    stem = words(path.stem)
    if any(map(_NOT_LABELS.fullmatch, stem)):
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
    """Return the words and numbers in a name, in lower case."""
    return re.findall(r"[a-z]+|[0-9]+", name.lower())


def _fold(name: list[str], after_split: bool) -> int | None:
    """Return the number after "fold", or a final number of 1 or 2 digits after the split."""
    for word, following in pairwise(name):
        if word == "fold" and following.isdigit():
            return int(following)
    ends = after_split and name[-1].isdigit() and len(name[-1]) <= 2
    return int(name[-1]) if ends and SPLIT_WORDS.keys() & set(name[:-1]) else None


def find_labels(
    directory: Path, split: str, fold: int | None = None, entire_tree: bool = False
) -> LabelFile:
    """Find the label file of a split.

    Args:
        directory: The dataset's folder, or one label file.
        split: "train", "val" or "test".
        fold: Which fold of a dataset with several.
        entire_tree: Find the labels of entire trees.

    Raises:
        DatasetError: If no label file or several match; the message lists what was found.
    """
    if directory.is_file():
        return _explicit_file(directory, split)
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
        raise DatasetError(_not_found_message(directory, split, fold, entire_tree, files))
    colour = [file for file in fitting if "rgb" in words(file.path.stem)]
    fitting = colour if len(colour) == 1 else fitting
    if len(fitting) > 1:
        listed = _listed(directory, fitting)
        raise DatasetError(
            f"{directory}: holds several label files for {split}: {listed}, expected one"
        )
    return fitting[0]


def _nearest(files: list[LabelFile]) -> list[LabelFile]:
    """Return the files in the dataset's folder; else those in label folders; else all."""

    def distance(file: LabelFile) -> int:
        folders = words(file.path.parent.relative_to(file.root).as_posix())
        known = SPLIT_WORDS.keys() | {"fold", "annotations", "labels"}
        return 0 if not folders else 1 if known & set(folders) else 2

    least = min(map(distance, files), default=0)
    return [file for file in files if distance(file) == least]


def find_splits(
    directory: Path, fold: int | None = None, entire_tree: bool = False
) -> list[LabelFile]:
    """Find the label files of all splits of a dataset, in the order train, val, test.

    Raises:
        DatasetError: As `find_labels`.
    """
    if directory.is_file():
        return [_explicit_file(directory, None)]
    files = label_files(directory)
    there = {file.split for file in files if file.entire_tree == entire_tree}
    wanted = [split for split in SPLITS if split in there] or ["train"]
    return [find_labels(directory, split, fold, entire_tree) for split in wanted]


def _not_found_message(
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
        hint = "; use --entire-tree for labels of entire trees"
    return f"{directory}: expected {wanted}, like {name}; found {_listed(directory, files)}{hint}"


def _listed(directory: Path, files: list[LabelFile]) -> str:
    names = [file.path.relative_to(directory).as_posix() for file in files]
    more = f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
    return ", ".join(names[:_MAX_LISTED]) + more


def _explicit_file(path: Path, split: str | None) -> LabelFile:
    """Return a label file given by its path; the split is "test" if its name has none."""
    recognised = _recognise(Path(path.name))
    named = recognised[0] if recognised else "test"
    if split not in (None, named):
        raise DatasetError(
            f"{path}: is a label file of split {named}, expected one of split {split} or a folder"
        )
    root = path.parent.parent if path.parent.name == "annotations" else path.parent
    return LabelFile(named, None, False, path, root)
