"""Read one split of a dataset."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from perceptree.data.coco import FrameRecord
from perceptree.data.content import load
from perceptree.data.entries import rows
from perceptree.data.grading import graded, ignored_note
from perceptree.data.layouts import LabelFile, find_labels
from perceptree.data.parsing import OnError, Parser
from perceptree.data.pictures import Pictures
from perceptree.data.tally import Tally
from perceptree.errors import DatasetError


@dataclass(frozen=True, eq=False)
class Dataset:
    """One split of a dataset.

    Attributes:
        labels: The label file.
        frames: Its frames.
        notes: Messages for the user about what was mapped or left out.
        has_masks: Whether every tree has a mask; ignored regions need none.
        has_keypoints: Whether any tree that counts has a labelled keypoint.
        has_depth: Whether every frame has an 8-bit depth image.
        tally: What was left out or taken in another way.
    """

    labels: LabelFile
    frames: list[FrameRecord]
    notes: tuple[str, ...]
    has_masks: bool
    has_keypoints: bool
    has_depth: bool
    tally: Tally


def read_dataset(
    directory: Path | str,
    split: str,
    fold: int | None = None,
    entire_tree: bool = False,
    certain_m: float | None = None,
    crowds_as_trees: bool = False,
    on_error: OnError | None = None,
) -> Dataset:
    """Read a split of a dataset in any layout of `perceptree.data.layouts`.

    Args:
        directory: The dataset's folder, or one label file.
        split: "train", "val" or "test".
        fold: Which fold of a dataset with several.
        entire_tree: Read the labels of entire trees (SynthTree43k).
        certain_m: Distance beyond which labelled trees are ignored, m; None for no limit.
        crowds_as_trees: Take run lengths with iscrowd 1 as trees also without keypoints.
        on_error: Called with each invalid entry, which is then left out. Without it, the first
            invalid entry is raised.

    Raises:
        DatasetError: If a file is missing or not COCO, a label is invalid, or no tree has the
            distance that `certain_m` needs.
        SettingsError: If `certain_m` is not over 0.
    """
    labels = find_labels(Path(directory), split, fold, entire_tree)
    return read_labels(labels, on_error, certain_m, crowds_as_trees)


def read_split(directory: Path | str, split: str) -> list[FrameRecord]:
    """Return the frames of a split; see `read_dataset`."""
    return read_dataset(directory, split).frames


def read_labels(
    labels: LabelFile,
    on_error: OnError | None = None,
    certain_m: float | None = None,
    crowds_as_trees: bool = False,
) -> Dataset:
    """Read a label file.

    Args:
        labels: The label file.
        on_error: As for `read_dataset`.
        certain_m: As for `read_dataset`.
        crowds_as_trees: As for `read_dataset`.

    Raises:
        DatasetError: If the file is not readable COCO, an entry is invalid, or no tree has the
            distance that `certain_m` needs.
        SettingsError: If `certain_m` is not over 0.
    """
    # A large file creates millions of objects: garbage collection would double the time.
    with _no_garbage_collection():
        try:
            content = load(labels.path)
        except DatasetError as error:
            raise DatasetError(f"{labels.path}: {error}") from error
        dataset = parse_content(content, labels, on_error, certain_m, crowds_as_trees)
    if labels.names_split:
        return dataset
    taken = f"{labels.path.name} names no split: taken as {labels.split}"
    return replace(dataset, notes=(*dataset.notes, taken))


def parse_content(
    content: Any,
    labels: LabelFile,
    on_error: OnError | None = None,
    certain_m: float | None = None,
    crowds_as_trees: bool = False,
) -> Dataset:
    """Convert the content of a COCO file to a split; empties `content`.

    Args:
        content: The content.
        labels: The file that it comes from; pictures are looked for around it.
        on_error: As for `read_dataset`.
        certain_m: As for `read_dataset`.
        crowds_as_trees: As for `read_dataset`.

    Raises:
        DatasetError: As `read_labels`.
        SettingsError: As `read_labels`.
    """
    try:
        pictures = Pictures(labels, rows(content, "images"))
        parsed = Parser(pictures, on_error, crowds_as_trees).parse(content, labels.keypoints)
        frames = parsed.frames if certain_m is None else graded(parsed.frames, certain_m)
    except DatasetError as error:
        raise DatasetError(f"{labels.path}: {error}") from error
    has_keypoints = any(
        (tree.keypoints[:, 2] > 0).any() for f in frames for tree in f.trees if not tree.ignored
    )
    without_depth = sum(frame.depth8_path is None for frame in frames)
    notes = parsed.notes + pictures.notes + ignored_note(frames, certain_m)
    if not has_keypoints:
        notes += ("no tree has a labelled keypoint",)
    return Dataset(
        labels, frames, notes, parsed.has_masks, has_keypoints, not without_depth, parsed.tally
    )


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Disable the cyclic garbage collector temporarily."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
