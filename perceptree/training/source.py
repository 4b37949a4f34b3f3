"""The data of a training: the cached train splits and the val split."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from basetree.counts import counted
from basetree.errors import SettingsError
from perceptree.data import Dataset, FrameStore, read_dataset
from perceptree.data.cache import (
    FrameCache,
    Progress,
    frames_key,
    load_in_order,
    open_cache,
)
from perceptree.data.coco import FrameRecord
from perceptree.data.dividing import DEFAULT_SHARES, divide
from perceptree.data.entries import EntryError
from perceptree.data.exact import with_exact_depth
from perceptree.data.grading import ignored_note
from perceptree.data.layouts import is_undivided
from perceptree.data.stated import labelled_reach_m
from perceptree.errors import DatasetError
from perceptree.models import ModelSpec
from perceptree.settings.training import DataSource, Engine
from perceptree.training.origin import simulated_scenes, usual_pictures

CACHE_FOLDER = ".frame-cache"
_NAMES_SHOWN = 3


@dataclass(frozen=True)
class Preparing:
    """Callbacks for the preparation of a training.

    Attributes:
        cached: Called with the number of cached frames and their total.
        say: Called with messages for the user.
    """

    cached: Progress = lambda done, total: None
    say: Callable[[str], None] = lambda line: None


@dataclass(frozen=True)
class TrainingData:
    """The cached train splits and the val split of a training.

    Attributes:
        name: Name of the dataset's folder, and of the one that is mixed in.
        frames: Frames of the train split.
        val: Frames of the val split.
        mixed: Frames of the train split that is mixed in; None if there is none.
        origin: What a checkpoint tells of the frames: `scenes` of the simulator and `pictures`,
            the usual ranges of their statistics, and `certain_m` or `reach_m` if it has one.
        certain_m: Distance beyond which labelled trees are ignored, m; None for no limit.
    """

    name: str
    frames: FrameCache
    val: FrameStore
    mixed: FrameCache | None = None
    origin: Mapping[str, Any] = field(default_factory=dict)
    certain_m: float | None = None

    def describe(self) -> dict[str, Any]:
        """Describe the data for a training state: name, numbers of frames and hashes."""
        mixed = {} if self.mixed is None else {"mixed frames hash": self.mixed.key}
        return {
            "name": self.name,
            "train": len(self.frames),
            "val": len(self.val),
            "val frames hash": frames_key(self.val.frames, self.val.spec, skip_broken=False),
            "frames hash": self.frames.key,
            "certain_m": self.certain_m,
            **mixed,
        }


def open_data(
    source: DataSource, spec: ModelSpec, engine: Engine, preparing: Preparing
) -> TrainingData:
    """Read the labels and open the frame cache of each train split, making it if needed.

    Args:
        source: The dataset, and the one to mix in.
        spec: Input and heads of the model.
        engine: Folder of the cache, and whether broken frames are skipped.
        preparing: Callbacks for progress and messages.

    Raises:
        DatasetError: If the data cannot be read, a split has no labelled tree that counts, or
            labels for a head of the model or distances for `certain_m` are missing.
    """
    certain_m = source.certain_m
    mixed = (
        []
        if source.mix is None
        else [
            replace(
                source,
                directory=source.mix,
                mix=None,
                fold=None,
                entire_tree=False,
                exact_depth=False,
            )
        ]
    )
    sources = [source, *mixed]
    val = _labelled(source, "val", preparing, engine)
    trains = [_labelled(each, "train", preparing, engine) for each in sources]
    if source.exact_depth:
        trains[0] = _exact(trains[0], spec)
    folders = [
        _cache_folder(each, train, spec, engine, mixed=number > 0)
        for number, (each, train) in enumerate(zip(sources, trains, strict=True))
    ]
    caches = [
        _open_cache(train, folder, spec, engine, preparing)
        for train, folder in zip(trains, folders, strict=True)
    ]
    sets = [(cache, train.frames) for cache, train in zip(caches, trains, strict=True)]
    scenes = simulated_scenes([frame for train in trains for frame in train.frames])
    reach_m = None if certain_m else labelled_reach_m(train.labels.root for train in trains)
    return TrainingData(
        ", ".join(each.directory.name for each in sources),
        caches[0],
        FrameStore(_readable(val, spec, preparing) if engine.skip_broken else val.frames, spec),
        caches[1] if len(caches) > 1 else None,
        {
            "scenes": scenes,
            "pictures": usual_pictures(sets, spec),
            **({} if certain_m is None else {"certain_m": certain_m}),
            **({} if reach_m is None else {"reach_m": reach_m}),
        },
        certain_m,
    )


def _exact(train: Dataset, spec: ModelSpec) -> Dataset:
    """The dataset with exact depth in place of the measured one."""
    if spec.modality != "depth":
        raise SettingsError(
            f"exact depth is for depth models: expected no --exact-depth for {spec.modality}"
        )
    return replace(train, frames=with_exact_depth(train.frames))


def _labelled(source: DataSource, split: str, preparing: Preparing, engine: Engine) -> Dataset:
    """Read the labels of a split; it must have a labelled tree that counts."""
    divided = source.fold is None and is_undivided(source.directory)
    dataset, broken = _read(source, "test" if divided else split, engine.skip_broken)
    if divided:
        dataset = _part(dataset, split)
    trees = [tree for frame in dataset.frames for tree in frame.trees]
    if not trees:
        raise DatasetError(
            f"{source.directory}: the {split} split has no labelled tree, expected at least one"
        )
    if all(tree.ignored for tree in trees):
        (reasons,) = ignored_note(dataset.frames, source.certain_m)
        hint = "; --crowds-as-trees takes run lengths as trees" if dataset.tally.crowds else ""
        raise DatasetError(
            f"{source.directory}: the {split} split has no tree that counts ({reasons}), expected"
            f" at least one{hint}"
        )
    for note in dataset.notes:
        preparing.say(f"{dataset.labels.path}: {note}")
    if broken:
        first = "; ".join(map(str, broken[:_NAMES_SHOWN]))
        preparing.say(f"{dataset.labels.path}: left out {len(broken)} broken entries: {first}")
    return dataset


def _part(dataset: Dataset, split: str) -> Dataset:
    """The train or val part of a dataset whose label file names no split."""
    parts = divide(dataset.frames, {"val": DEFAULT_SHARES["val"]})
    count, name = len(parts["val"]), dataset.labels.path.name
    note = (
        f"{name} names no split: {count} of {counted(len(dataset.frames), 'picture')} are"
        " val, with those that"
        " look alike on one side; all are seen by this training, so that only pictures of"
        " elsewhere tell how good it is (perceptree data split sets some apart)"
    )
    notes = (note,) if split == "val" else ()
    labels = replace(dataset.labels, split=split)
    without_last = dataset.notes[:-1]  # the last one says that the file counts as test
    return replace(dataset, labels=labels, frames=parts[split], notes=notes + without_last)


def _read(source: DataSource, split: str, skip_broken: bool) -> tuple[Dataset, list[EntryError]]:
    """Read the labels of a split, and return the broken entries that were left out."""
    broken: list[EntryError] = []
    try:
        dataset = read_dataset(
            source.directory,
            split,
            source.fold,
            source.entire_tree,
            source.certain_m,
            source.crowds_as_trees,
            broken.append if skip_broken else None,
        )
    except DatasetError as error:
        if isinstance(error.__cause__, EntryError):
            raise DatasetError(f"{error}; --skip-broken leaves broken entries out") from error
        raise
    return dataset, broken


def _open_cache(
    train: Dataset, folder: Path, spec: ModelSpec, engine: Engine, preparing: Preparing
) -> FrameCache:
    """Open the frame cache of a train split, and say which frames it leaves out."""
    _check_labels(train, spec)
    cache = open_cache(train.frames, spec, folder, engine.skip_broken, preparing.cached)
    _tell_broken(train, [entry.reason for entry in cache.skipped], preparing)
    return cache


def _readable(val: Dataset, spec: ModelSpec, preparing: Preparing) -> list[FrameRecord]:
    """The frames of a val split whose files can be read; all are decoded once."""
    readable, broken = [], []
    for frame, sample in load_in_order(val.frames, spec):
        error = sample.exception()
        if error is None:
            readable.append(frame)
        elif isinstance(error, DatasetError):
            broken.append(str(error))
        else:
            raise error
    _tell_broken(val, broken, preparing)
    return readable


def _tell_broken(dataset: Dataset, reasons: list[str], preparing: Preparing) -> None:
    """Say which frames are left out; some must remain."""
    if reasons:
        first = "; ".join(reasons[:_NAMES_SHOWN])
        if len(reasons) == len(dataset.frames):
            raise DatasetError(f"{dataset.labels.path}: all frames are broken: {first}")
        left_out = counted(len(reasons), "broken frame")
        preparing.say(f"left out {left_out} of {dataset.labels.split}: {first}")


def _check_labels(dataset: Dataset, spec: ModelSpec) -> None:
    path = dataset.labels.path
    if spec.masks and not dataset.has_masks:
        raise DatasetError(f"{path}: trees have no masks, expected masks, or --no-masks")
    if spec.keypoints and not dataset.has_keypoints:
        raise DatasetError(
            f"{path}: no tree has a labelled keypoint, expected keypoints, or --no-keypoints"
        )


def _cache_folder(
    source: DataSource, train: Dataset, spec: ModelSpec, engine: Engine, *, mixed: bool
) -> Path:
    """The cache folder of a label file, modality and input size."""
    directory = source.directory if source.directory.is_dir() else source.directory.parent
    parent = directory / CACHE_FOLDER if engine.cache is None else Path(engine.cache)
    name = f"{train.labels.path.stem}-{spec.modality}-{spec.width}x{spec.height}"
    if source.certain_m is not None:
        name += f"-certain-{source.certain_m:g}"
    if source.exact_depth:
        name += "-exact"
    return parent / (f"mixed-{name}" if mixed and engine.cache is not None else name)
