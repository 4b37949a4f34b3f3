"""Read one split of a dataset."""

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
from perceptree.data.grading import graded, ignored_note
from perceptree.data.layouts import LabelFile, find_labels
from perceptree.data.parsing import OnError, Parser
from perceptree.data.pictures import Pictures
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
        outside: (annotation id, x, y) of keypoints outside their frame.
    """

    labels: LabelFile
    frames: list[FrameRecord]
    notes: tuple[str, ...]
    has_masks: bool
    has_keypoints: bool
    has_depth: bool
    outside: list[tuple[int, float, float]]


def read_dataset(
    directory: Path | str,
    split: str,
    fold: int | None = None,
    entire_tree: bool = False,
    certain_m: float | None = None,
) -> Dataset:
    """Read a split of a dataset in any layout of `perceptree.data.layouts`.

    Args:
        directory: The dataset's folder, or one label file.
        split: "train", "val" or "test".
        fold: Which fold of a dataset with several.
        entire_tree: Read the labels of entire trees (SynthTree43k).
        certain_m: Distance beyond which labelled trees are ignored, m; None for no limit.

    Raises:
        DatasetError: If a file is missing or not COCO, a label is invalid, or no tree has the
            distance that `certain_m` needs.
        SettingsError: If `certain_m` is not over 0.
    """
    return read_labels(find_labels(Path(directory), split, fold, entire_tree), certain_m=certain_m)


def read_split(directory: Path | str, split: str) -> list[FrameRecord]:
    """Return the frames of a split; see `read_dataset`."""
    return read_dataset(directory, split).frames


def read_labels(
    labels: LabelFile, on_error: OnError | None = None, certain_m: float | None = None
) -> Dataset:
    """Read a label file.

    Args:
        labels: The label file.
        on_error: Called with each invalid entry, which is then left out. Without it, the first
            invalid entry is raised.
        certain_m: As for `read_dataset`.

    Raises:
        DatasetError: If the file is not readable COCO, an entry is invalid, or no tree has the
            distance that `certain_m` needs.
        SettingsError: If `certain_m` is not over 0.
    """
    try:
        # A large file creates millions of objects: garbage collection would double the time.
        with _no_garbage_collection():
            content = _load(labels.path)
            pictures = Pictures(labels, rows(content, "images"))
            parsed = Parser(pictures, on_error).parse(content)
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
        raise DatasetError(f"not readable JSON ({error}), expected a COCO file") from error


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
