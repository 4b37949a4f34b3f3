"""Read labels of any form that is known, told by what a folder or file holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from perceptree.data.dataset import Dataset, parse_content, read_labels
from perceptree.data.exchange.cvat import cvat_files, read_cvat
from perceptree.data.exchange.label_studio import label_studio_files, read_label_studio
from perceptree.data.exchange.labelme import labelme_files, read_labelme
from perceptree.data.exchange.yolo import SETTINGS_NAMES, is_yolo, read_yolo
from perceptree.data.layouts import LabelFile, find_splits, label_files
from perceptree.data.parsing import OnError
from perceptree.errors import DatasetError

Content = tuple[str | None, Path, dict[str, Any], list[str]]
_Reader = Callable[[Path], Iterator[Content]]

NO_SPLIT = "test"
"""The split of labels that name none, as in `perceptree.data.layouts`."""


def read_any(
    source: Path, crowds_as_trees: bool = False, on_error: OnError | None = None
) -> list[tuple[str | None, Dataset]]:
    """Read the labels of a folder or file in COCO's form or that of a labelling tool.

    Args:
        source: The folder or file.
        crowds_as_trees: As for `perceptree.data.dataset.read_dataset`.
        on_error: As for `perceptree.data.dataset.read_dataset`.

    Returns:
        The datasets with their splits; None for labels that name no split.

    Raises:
        DatasetError: If there are no labels, or they are broken.
        InputFileError: If a file cannot be read.
    """
    if not source.exists():
        raise DatasetError(f"{source}: no such file or folder, expected labels")
    if source.name in SETTINGS_NAMES:
        source = source.parent
    found = _reader(source)
    if found is None:
        files = find_splits(source)
        return [_read_coco(labels, crowds_as_trees, on_error) for labels in files]
    root = source if source.is_dir() else source.parent
    datasets: list[tuple[str | None, Dataset]] = []
    for split, path, content, notes in found(source):
        labels = LabelFile(split or NO_SPLIT, None, False, path, root)
        dataset = parse_content(content, labels, on_error, crowds_as_trees=crowds_as_trees)
        datasets.append((split, replace(dataset, notes=(*notes, *dataset.notes))))
    if not datasets:
        raise DatasetError(f"{source}: holds no labelled picture, expected at least one")
    return datasets


def _read_coco(
    labels: LabelFile, crowds_as_trees: bool, on_error: OnError | None
) -> tuple[str | None, Dataset]:
    dataset = read_labels(labels, on_error, crowds_as_trees=crowds_as_trees)
    if labels.names_split:
        return labels.split, dataset
    without_last = dataset.notes[:-1]  # the last one says that the file counts as test
    return None, replace(dataset, notes=without_last)


def _reader(source: Path) -> _Reader | None:
    """The reader of a source that is not in COCO's form."""
    if source.is_dir() and label_files(source):
        return None
    if source.is_file():
        if source.suffix.lower() == ".xml":
            return read_cvat
        return read_label_studio if source in label_studio_files(source.parent) else None
    if is_yolo(source):
        return read_yolo
    if label_studio_files(source):
        return read_label_studio
    if cvat_files(source):
        return read_cvat
    return read_labelme if labelme_files(source) else None
