"""Run all checks of a dataset: each frame in parallel threads, then the splits."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from basetree.counts import counted
from perceptree.data.check.findings import Finding, Findings
from perceptree.data.check.labels import label_faults
from perceptree.data.check.leakage import file_leaks, picture_leaks, scene_leaks, scene_of
from perceptree.data.check.pictures import Signature, colour_faults, depth_faults
from perceptree.data.coco import FrameRecord
from perceptree.data.dataset import Dataset, read_labels
from perceptree.data.entries import EntryError
from perceptree.data.layouts import LabelFile, find_splits
from perceptree.data.orientation import ORIENTED
from perceptree.data.tally import Tally

Progress = Callable[[int], object]
Faults = list[tuple[str, str]]

_BATCH_SIZE = 64


@dataclass(frozen=True)
class SplitSummary:
    """Content of a split.

    Attributes:
        split: "train", "val" or "test".
        labels: Path of the label file.
        frames: Number of frames.
        trees: Number of labelled trees that count; ignored regions do not.
        has_masks: Whether every tree has a mask.
        has_keypoints: Whether any tree has a labelled keypoint.
        has_depth: Whether every frame has an 8-bit depth image.
        notes: Messages about reading the labels.
    """

    split: str
    labels: str
    frames: int
    trees: int
    has_masks: bool
    has_keypoints: bool
    has_depth: bool
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Report:
    """Result of the check.

    Attributes:
        splits: Content of each split.
        findings: Problems found.
        compared_by: How the splits were compared for leakage: "scene" or "picture".
    """

    splits: tuple[SplitSummary, ...]
    findings: tuple[Finding, ...]
    compared_by: str

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return asdict(self)


class Check:
    """Checks a dataset: the constructor reads the labels, `run` checks every frame.

    Raises:
        DatasetError: If the dataset has no readable label file.
    """

    def __init__(
        self,
        directory: Path | str,
        fold: int | None = None,
        entire_tree: bool = False,
        crowds_as_trees: bool = False,
    ) -> None:
        self._findings = Findings()
        self._splits: dict[str, Dataset] = {}
        self._oriented: defaultdict[str, Counter[str]] = defaultdict(Counter)
        for labels in find_splits(Path(directory), fold, entire_tree):
            self._splits[labels.split] = read_labels(
                labels, partial(self._wrong_entry, labels), crowds_as_trees=crowds_as_trees
            )

    def _wrong_entry(self, labels: LabelFile, error: EntryError) -> None:
        self._findings.add("entry", f"{labels.path.name}: {error}")

    def __len__(self) -> int:
        """Return the number of frames."""
        return sum(len(dataset.frames) for dataset in self._splits.values())

    def run(self, progress: Progress = lambda frames: None) -> Report:
        """Check every frame, then compare the splits.

        Args:
            progress: Called with the number of further frames done.
        """
        signatures: dict[str, list[Signature | None]] = {}
        with ThreadPoolExecutor() as pool:
            for split, dataset in self._splits.items():
                self._tell(split, dataset.tally)
                found = signatures[split] = []
                for frames in _batches(dataset.frames):
                    for faults, signature, how in pool.map(_check_frame, frames):
                        self._findings.extend((kind, f"{split} {where}") for kind, where in faults)
                        found.append(signature)
                        self._oriented[split][how] += 1
                    progress(len(frames))
        compared_by = self._compare(signatures)
        summaries = tuple(
            _summary(split, data, self._oriented[split]) for split, data in self._splits.items()
        )
        return Report(summaries, self._findings.listed(), compared_by)

    def _tell(self, split: str, tally: Tally) -> None:
        """Record what the reader left out."""
        for kind, number in tally.left_out:
            self._findings.add(kind, f"{split} annotation {number}")
        for number, x, y in tally.outside:
            self._findings.add(
                "keypoint_outside", f"{split} annotation {number} at {x:.6g}, {y:.6g}"
            )

    def _compare(self, signatures: dict[str, list[Signature | None]]) -> str:
        """Look for leakage by scene if every frame names its scene, otherwise by image."""
        frames = {split: dataset.frames for split, dataset in self._splits.items()}
        self._findings.extend(("file_in_splits", name) for name in file_leaks(frames))
        if all(scene_of(frame) is not None for split in frames.values() for frame in split):
            self._findings.extend(("scene_in_splits", name) for name in scene_leaks(frames))
            return "scene"
        leaks = picture_leaks(frames, signatures)
        self._findings.extend(("picture_in_splits", name) for name in leaks)
        return "picture"


def _batches(frames: Sequence[FrameRecord]) -> Iterator[list[FrameRecord]]:
    """Yield a few frames at a time, to limit memory."""
    remaining = iter(frames)
    while batch := list(islice(remaining, _BATCH_SIZE)):
        yield batch


def _check_frame(frame: FrameRecord) -> tuple[Faults, Signature | None, str]:
    """Return (kind, where) of a frame's problems, its image's signature and how that is turned."""
    name = frame.image_path.name
    kinds, signature, how = colour_faults(frame)
    faults: Faults = [(kind, str(frame.image_path)) for kind in kinds]
    faults += [(kind, str(path)) for kind, path in depth_faults(frame)]
    faults += [(kind, f"{name} annotation {number}") for kind, number in label_faults(frame)]
    return faults, signature, how


def _without_depth(dataset: Dataset) -> list[str]:
    """What a dataset without 8-bit depth, or with some, is good for."""
    if dataset.has_depth:
        return []
    count = sum(frame.depth8_path is None for frame in dataset.frames)
    share = "" if count == len(dataset.frames) else f" for {counted(count, 'frame')}"
    return [f"no 8-bit depth{share}: for colour, --modality rgb"]


def _summary(split: str, dataset: Dataset, oriented: Counter[str]) -> SplitSummary:
    turned = [f"{oriented[how]} {text}" for how, text in ORIENTED.items() if oriented[how]]
    return SplitSummary(
        split,
        str(dataset.labels.path),
        len(dataset.frames),
        sum(not tree.ignored for frame in dataset.frames for tree in frame.trees),
        dataset.has_masks,
        dataset.has_keypoints,
        dataset.has_depth,
        (*dataset.notes, *_without_depth(dataset), *turned),
    )
