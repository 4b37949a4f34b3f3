"""A split of a dataset: its frames, what to tell the user of it, what its labels hold."""

from __future__ import annotations

import gc
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from perceptree.data.coco import FrameRecord
from perceptree.data.entries import rows
from perceptree.data.layouts import LabelFile, find_labels
from perceptree.data.parsing import OnError, Parser
from perceptree.data.pictures import Pictures
from perceptree.errors import DatasetError


@dataclass(frozen=True, eq=False)
class Dataset:
    """One split as it was read.

    ``labels`` is its label file; ``notes`` are lines for the user on what was mapped or left out;
    ``has_masks`` says whether every tree has a mask (a crowd may do without), ``has_keypoints``
    whether any tree has a labelled keypoint, ``has_depth`` whether every frame names an 8-bit
    depth picture; ``outside`` holds (annotation, x, y) of keypoints that lie outside their frame.
    """

    labels: LabelFile
    frames: list[FrameRecord]
    notes: tuple[str, ...]
    has_masks: bool
    has_keypoints: bool
    has_depth: bool
    outside: list[tuple[int, float, float]]


def read_dataset(
    directory: Path | str, split: str, fold: int | None = None, entire_tree: bool = False
) -> Dataset:
    """A split of a dataset in any of the layouts of `perceptree.data.layouts`.

    ``directory`` is the dataset's folder, or one label file; ``fold`` chooses one where there are
    several, ``entire_tree`` the labels of entire trees. Raises DatasetError, in one line, for a
    missing file, one that is not COCO, or a label that contradicts its frame.
    """
    return read_labels(find_labels(Path(directory), split, fold, entire_tree))


def read_split(directory: Path | str, split: str) -> list[FrameRecord]:
    """The frames of a split; see `read_dataset`."""
    return read_dataset(directory, split).frames


def read_labels(labels: LabelFile, on_error: OnError | None = None) -> Dataset:
    """What a label file holds.

    Without ``on_error`` the first wrong entry is raised as DatasetError; with it, each wrong entry
    is handed over and left out.
    """
    try:
        # A large file makes millions of objects that live on: searching them for cycles meanwhile
        # takes as long as the reading.
        with _no_cycle_search():
            content = _load(labels.path)
            pictures = Pictures(labels, rows(content, "images"))
            parsed = Parser(pictures, on_error).parse(content)
    except DatasetError as error:
        raise DatasetError(f"{labels.path}: {error}") from error
    frames = parsed.frames
    has_keypoints = any((tree.keypoints[:, 2] > 0).any() for f in frames for tree in f.trees)
    without_depth = sum(frame.depth8_path is None for frame in frames)
    notes = parsed.notes + pictures.notes
    if not has_keypoints:
        notes += ("no tree has a labelled keypoint",)
    if without_depth:
        share = "" if without_depth == len(frames) else f" for {without_depth} frames"
        notes += (f"no 8-bit depth{share}: for colour, --modality rgb",)
    return Dataset(
        labels, frames, notes, parsed.has_masks, has_keypoints, not without_depth, parsed.outside
    )


def _load(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise DatasetError(f"not readable JSON ({error})") from error


@contextmanager
def _no_cycle_search() -> Iterator[None]:
    """Switch Python's search for reference cycles off for a while, if it was on."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
