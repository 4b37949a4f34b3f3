"""The data of a training: the cached train split and the val split."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from perceptree.data import Dataset, FrameStore, read_dataset
from perceptree.data.cache import FrameCache, Progress, open_cache
from perceptree.errors import DatasetError
from perceptree.models import ModelSpec
from perceptree.training.settings import Engine

CACHE_FOLDER = ".frame-cache"
_NAMES_SHOWN = 3


@dataclass(frozen=True)
class DataSource:
    """A dataset, and the choice among its label files.

    Attributes:
        directory: Folder of the dataset, or a label file.
        fold: Fold of a cross-validation, for datasets that have folds.
        entire_tree: Use the labels of entire trees, for datasets that have them.
    """

    directory: Path
    fold: int | None = None
    entire_tree: bool = False


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
    """The cached train split and the val split of a dataset.

    Attributes:
        name: Name of the dataset's folder.
        frames: Frames of the train split.
        val: Frames of the val split.
    """

    name: str
    frames: FrameCache
    val: FrameStore

    def describe(self) -> dict[str, Any]:
        """Describe the data for a training state: name, numbers of frames and a hash."""
        return {
            "name": self.name,
            "train": len(self.frames),
            "val": len(self.val),
            "frames hash": self.frames.key,
        }


def open_data(
    source: DataSource, spec: ModelSpec, engine: Engine, preparing: Preparing
) -> TrainingData:
    """Read a dataset's labels and open the frame cache of its train split, making it if needed.

    Args:
        source: The dataset.
        spec: Input and heads of the model.
        engine: Folder of the cache, and whether broken frames are skipped.
        preparing: Callbacks for progress and messages.

    Raises:
        DatasetError: If the data cannot be read, a split has no labelled tree, or labels for a
            head of the model are missing.
    """
    sets = {
        split: read_dataset(source.directory, split, source.fold, source.entire_tree)
        for split in ("train", "val")
    }
    for split, dataset in sets.items():
        if not any(not tree.crowd for frame in dataset.frames for tree in frame.trees):
            raise DatasetError(
                f"{source.directory}: the {split} split has no labelled tree, expected at least one"
            )
        for note in dataset.notes:
            preparing.say(f"{dataset.labels.path}: {note}")
    train = sets["train"]
    _check_labels(train, spec)
    folder = _cache_folder(source, train, spec, engine)
    cache = open_cache(train.frames, spec, folder, engine.skip_broken, preparing.cached)
    if cache.skipped:
        first = "; ".join(entry.reason for entry in cache.skipped[:_NAMES_SHOWN])
        preparing.say(f"left out {len(cache.skipped)} broken frames: {first}")
    return TrainingData(source.directory.name, cache, FrameStore(sets["val"].frames, spec))


def _check_labels(dataset: Dataset, spec: ModelSpec) -> None:
    path = dataset.labels.path
    if spec.masks and not dataset.has_masks:
        raise DatasetError(f"{path}: trees have no masks, expected masks, or --no-masks")
    if spec.keypoints and not dataset.has_keypoints:
        raise DatasetError(
            f"{path}: no tree has a labelled keypoint, expected keypoints, or --no-keypoints"
        )


def _cache_folder(source: DataSource, train: Dataset, spec: ModelSpec, engine: Engine) -> Path:
    """The cache folder of a label file, modality and input size."""
    directory = source.directory if source.directory.is_dir() else source.directory.parent
    parent = directory / CACHE_FOLDER if engine.cache is None else Path(engine.cache)
    return parent / f"{train.labels.path.stem}-{spec.modality}-{spec.width}x{spec.height}"
