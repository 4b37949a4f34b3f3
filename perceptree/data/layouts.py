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

Where no name fits, such as Label Studio's `result.json`, any JSON file that holds images,
annotations and categories is one. A file whose name and folder say no split counts as "test".
If one file of a split has keypoints and another one none, as COCO and CVAT write them, the
keypoints of the first are joined to the annotations of the second.

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
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from perceptree.data.coco import SPLITS
from perceptree.data.content import has_keypoints, is_coco
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
_OTHER_LABELS = re.compile("captions|panoptic|stuff")
_NOT_LABELS = re.compile(
    "info|results?|predictions|detections|settings|statistics|metrics|report|log"
)
# Names of these words have no split: the folder's name gives it, else it is "test".
_PLAIN_WORDS = frozenset(
    ("annotations", "coco", "instances", "person", "keypoints", "default", "labels")
)
_MAX_LISTED = 8
_PATTERNS = ("*.json", "*/*.json", "fold*/annotations/*.json")
_MOST_FILES = 20_000  # that are looked into
_HOW_TO_SPLIT = (
    "; a file that names no split counts as test: perceptree data split divides it into train, val"
    " and test"
)


@dataclass(frozen=True, order=True)
class LabelFile:
    """A label file.

    Attributes:
        split: "train", "val" or "test".
        fold: Number of the fold, if any.
        entire_tree: Whether the labels are of entire trees.
        path: The file.
        root: The dataset's folder.
        keypoints: A second file of the split, with the keypoints.
    """

    split: str
    fold: int | None
    entire_tree: bool
    path: Path
    root: Path
    keypoints: Path | None = None

    @property
    def names_split(self) -> bool:
        """Whether the file's name or folder says the split."""
        return bool(_splits_in(self.path.relative_to(self.root)))


def label_files(directory: Path) -> list[LabelFile]:
    """Return all label files in a dataset's folder and one folder below.

    They are told by their names; if no name fits, by what the files hold.
    """
    paths = [path for pattern in _PATTERNS for path in sorted(directory.glob(pattern))]
    found = [
        LabelFile(*recognised, path, directory)
        for path in paths
        if (recognised := _recognise(path.relative_to(directory))) is not None
    ] or [
        _unnamed(path, directory)
        for path in paths[:_MOST_FILES]
        if not any(map(_OTHER_LABELS.fullmatch, words(path.stem))) and is_coco(path)
    ]
    # If there are label files for colour and depth, they are the same: use those for colour.
    colour = [file for file in found if "depth" not in file.path.stem.lower()]
    return sorted(colour or found, key=lambda file: (file.split, file.fold or 0, file.path))


def _recognise(path: Path) -> tuple[str, int | None, bool] | None:
    """Return (split, fold, entire tree) from a file's name and folders; None for other files."""
    stem = words(path.stem)
    if any(_NOT_LABELS.fullmatch(word) or _OTHER_LABELS.fullmatch(word) for word in stem):
        return None
    splits = _splits_in(Path(path.name))
    if not splits and stem and _PLAIN_WORDS.issuperset(stem):
        splits = _splits_in(path.parent) or {"test"}
    if len(splits) != 1:
        return None
    return splits.pop(), _fold_of(path), "entire" in stem


def _unnamed(path: Path, directory: Path) -> LabelFile:
    """A label file that its content tells, not its name."""
    inside = path.relative_to(directory)
    splits = _splits_in(Path(path.name)) or _splits_in(inside.parent)
    split = splits.pop() if len(splits) == 1 else "test"
    return LabelFile(split, _fold_of(inside), "entire" in words(path.stem), path, directory)


def _splits_in(path: Path) -> set[str]:
    """The splits that the words of a path name."""
    return {SPLIT_WORDS[word] for word in words(path.as_posix()) if word in SPLIT_WORDS}


def _fold_of(path: Path) -> int | None:
    fold = _fold(words(path.parent.as_posix()), after_split=False)
    return _fold(words(path.stem), after_split=True) if fold is None else fold


def words(name: str) -> list[str]:
    """Return the words and numbers in a name, in lower case."""
    return re.findall(r"[a-z]+|[0-9]+", name.lower())


def _fold(name: list[str], after_split: bool) -> int | None:
    """Return the number after "fold", or a final number of 1 or 2 digits after the split."""
    for word, following in pairwise(name):
        if word == "fold" and following.isdigit():
            return int(following)
    ends = after_split and bool(name) and name[-1].isdigit() and len(name[-1]) <= 2
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
    fitting = colour if len(colour) == 1 else _joined(fitting)
    if len(fitting) > 1:
        listed = _listed(directory, [file.path for file in fitting])
        raise DatasetError(
            f"{directory}: holds several label files for {split}: {listed}, expected one"
        )
    return fitting[0]


def _joined(files: list[LabelFile]) -> list[LabelFile]:
    """Join two files of which one alone has keypoints; return others unchanged."""
    if len(files) != 2 or files[0].path.parent != files[1].path.parent:
        return files
    with_points = [file for file in files if has_keypoints(file.path)]
    if len(with_points) != 1:
        return files
    (other,) = (file for file in files if file not in with_points)
    return [replace(other, keypoints=with_points[0].path)]


def _nearest(files: list[LabelFile]) -> list[LabelFile]:
    """Return the files in the dataset's folder; else those in label folders; else all."""

    def distance(file: LabelFile) -> int:
        folders = words(file.path.parent.relative_to(file.root).as_posix())
        known = SPLIT_WORDS.keys() | {"fold", "annotations", "labels"}
        return 0 if not folders else 1 if known & set(folders) else 2

    least = min(map(distance, files), default=0)
    return [file for file in files if distance(file) == least]


def is_undivided(source: Path) -> bool:
    """Whether a dataset's folder, or a label file, names no split at all."""
    if source.is_file():
        return not _explicit_file(source, None).names_split
    files = label_files(source)
    return bool(files) and not any(file.names_split for file in files)


def dataset_folder(source: Path) -> Path:
    """The folder of a dataset that is given as a folder, or as one of its label files."""
    return _explicit_file(source, None).root if source.is_file() else source


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
            f"{_others(directory)}"
        )
    wanted = f"{'entire-tree ' * entire_tree}labels of {split}"
    wanted += "" if fold is None else f" in fold {fold}"
    hint = ""
    if not entire_tree and any(file.entire_tree and file.split == split for file in files):
        hint = "; use --entire-tree for labels of entire trees"
    elif not any(file.names_split for file in files):
        hint = _HOW_TO_SPLIT
    found = _listed(directory, [file.path for file in files])
    return f"{directory}: expected {wanted}, like {name}; found {found}{hint}"


def _others(directory: Path) -> str:
    """Name the JSON files of a folder without label files."""
    found = sorted(path for pattern in _PATTERNS for path in directory.glob(pattern))
    named = f"; no COCO labels (images, annotations, categories) in {_listed(directory, found)}"
    other = "; perceptree data convert reads YOLO, labelme, and exports of CVAT and Label Studio"
    return (named if found else "") + other


def _listed(directory: Path, paths: list[Path]) -> str:
    names = [path.relative_to(directory).as_posix() for path in paths]
    more = f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
    return ", ".join(names[:_MAX_LISTED]) + more


def _explicit_file(path: Path, split: str | None) -> LabelFile:
    """Return a label file given by its path; the split is "test" if its name has none."""
    splits = _splits_in(Path(path.name))
    named = splits.pop() if len(splits) == 1 else "test"
    if split not in (None, named):
        how = "" if _splits_in(Path(path.name)) else _HOW_TO_SPLIT
        raise DatasetError(
            f"{path}: is a label file of split {named}, expected one of split {split} or a"
            f" folder{how}"
        )
    root = path.parent.parent if path.parent.name == "annotations" else path.parent
    return LabelFile(named, None, False, path, root)
