"""Evaluations in shards: predictions of a block of frames, and the report that all shards make."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import tempfile
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np
import torch

from basetree.files.limits import current_limits
from basetree.jobs import Job, JobError, LocalStore, MergedParts, Store, fetch, is_url, open_store
from perceptree.data import SPLITS, Dataset, FrameRecord, FrameStore, read_dataset
from perceptree.data.frames import source_paths
from perceptree.evaluation.figures import About, figures_of
from perceptree.evaluation.metrics import check_trees, measured_from
from perceptree.evaluation.predictions import (
    FramePrediction,
    on_device,
    predict_frames,
    predict_with,
)
from perceptree.evaluation.report import Report
from perceptree.models import ModelSpec, load_checkpoint

KIND = "perceptree.eval"
BLOCK_FRAMES = 32
BATCH = 4


@dataclass(frozen=True)
class SplitSource:
    """A split of a dataset, in a folder or at a URL.

    Attributes:
        data: Folder, label file or URL of the dataset.
        split: "train", "val" or "test".
        fold: Which fold of a dataset with several.
        entire_tree: Whether the labels of entire trees are read.
        certain_m: Distance beyond which labelled trees are ignored, m; None for no limit.
        crowds_as_trees: Whether run lengths with iscrowd 1 are trees also without keypoints.
    """

    data: str
    split: str
    fold: int | None
    entire_tree: bool
    certain_m: float | None = None
    crowds_as_trees: bool = False

    @contextmanager
    def opened(self) -> Iterator[Dataset]:
        """Read the labels; those at a URL are copied to this machine meanwhile.

        Raises:
            DatasetError: If there are no labels of the split, or they are not COCO.
            StoreError: If a file at the URL cannot be read.
        """
        options = (
            self.split,
            self.fold,
            self.entire_tree,
            self.certain_m,
            self.crowds_as_trees,
        )
        if not is_url(self.data):
            yield read_dataset(self.data, *options)
            return
        store = open_store(self.data)
        with tempfile.TemporaryDirectory() as folder:
            labels = [
                name
                for inside in ("", "annotations")
                for name in store.sizes(inside)
                if name.endswith(".json")
            ]
            fetch(store, labels, Path(folder))
            yield read_dataset(folder, *options)

    def fetch_images(self, dataset: Dataset, frames: Sequence[FrameRecord], modality: str) -> None:
        """Copy the images of frames to where an opened dataset expects them, from a URL.

        Raises:
            DatasetError: If a frame has no depth image for a depth model.
            StoreError: If an image cannot be read.
        """
        if not is_url(self.data):
            return
        root = dataset.labels.root
        paths = [
            path.relative_to(root) for frame in frames for path in source_paths(frame, modality)
        ]
        fetch(open_store(self.data), [path.as_posix() for path in paths], root)

    def drop_images(self, frames: Sequence[FrameRecord], modality: str) -> None:
        """Remove the copies of images from a URL."""
        if is_url(self.data):
            for frame in frames:
                for path in source_paths(frame, modality):
                    path.unlink(missing_ok=True)


@dataclass(frozen=True)
class EvalWork:
    """What a worker needs to predict; sent to the machines that work.

    Attributes:
        checkpoint: Content of the checkpoint.
        source: The frames.
        labels_sha256: SHA-256 of the label file.
        device: "cpu" or "cuda".
        threads: Threads of the network; all cores if None.
    """

    checkpoint: bytes
    source: SplitSource
    labels_sha256: str
    device: str
    threads: int | None

    def __call__(self) -> Callable[[int], bytes]:
        """Load the checkpoint; returns what predicts a block of frames.

        Raises:
            JobError: If this machine does not see the same labels.
            InputError: If the checkpoint or the labels cannot be read.
        """
        if self.threads is not None:
            torch.set_num_threads(self.threads)
        with tempfile.TemporaryDirectory() as folder:
            LocalStore(Path(folder)).write("model.safetensors", self.checkpoint)
            model, _ = load_checkpoint(Path(folder) / "model.safetensors")
        predict, spec = predict_with(on_device(model, self.device)), model.spec
        opened = ExitStack()  # copies of labels live as long as the worker
        dataset = opened.enter_context(self.source.opened())
        if labels_sha256(dataset) != self.labels_sha256:
            raise JobError(
                f"{self.source.data}: a worker sees other labels than the command that started it;"
                " expected a folder that all machines share, or a URL"
            )

        def work(unit: int) -> bytes:
            frames = dataset.frames[unit * BLOCK_FRAMES : (unit + 1) * BLOCK_FRAMES]
            self.source.fetch_images(dataset, frames, spec.modality)
            found = predict_frames(predict, FrameStore(frames, spec), BATCH)
            content = json.dumps([_record(prediction) for prediction in found]).encode()
            self.source.drop_images(frames, spec.modality)
            return content

        weakref.finalize(work, opened.close)
        return work


def labels_sha256(dataset: Dataset) -> str:
    """Hash a dataset's label file, and the second one that its keypoints are from."""
    labels = dataset.labels
    digest = hashlib.sha256(labels.path.read_bytes())
    if labels.keypoints is not None:
        digest.update(hashlib.sha256(labels.keypoints.read_bytes()).digest())
    return digest.hexdigest()


def eval_job(
    store: Store, source: SplitSource, work: EvalWork, spec: ModelSpec, about: dict[str, Any]
) -> Job:
    """Make the job of predicting all frames of a split.

    Args:
        store: Where the parts are kept.
        source: The frames, as the user typed them.
        work: What a worker needs.
        spec: The model.
        about: JSON-ready description of the model, for the report.

    Raises:
        DatasetError: If the split has no labelled tree that counts.
    """
    identity = {
        "checkpoint_sha256": hashlib.sha256(work.checkpoint).hexdigest(),
        "labels_sha256": work.labels_sha256,
        "source": dataclasses.asdict(source),
        "spec": spec.to_dict(),
        "about": about,
    }
    with work.source.opened() as dataset:
        frames = len(dataset.frames)
        check_trees(FrameStore(dataset.frames, spec))
    return Job(store, KIND, identity, frames, BLOCK_FRAMES)


def merge_evaluation(parts: MergedParts, out: Path | None) -> tuple[dict[str, Any], Path | None]:
    """Make the report of all shards: figure for figure that of one machine.

    Args:
        parts: The shards.
        out: Folder of the report; None for the figures alone.

    Returns:
        The figures, and the page of the report if there is one.

    Raises:
        JobError: If the labels are not those of the shards.
        InputError: If the dataset cannot be read, or the report not written.
    """
    identity, where = parts.job.identity, parts.job.store.where
    source, spec = _source_and_spec(identity, where)
    predictions = [one for content in parts for one in read_predictions(content, where)]
    with source.opened() as dataset:
        if labels_sha256(dataset) != identity["labels_sha256"]:
            raise JobError(f"{source.data}: has other labels than the shards were made with")
        store = FrameStore(dataset.frames, spec)
        about = About(identity["about"], source.data, source.split, dataset.notes, source.certain_m)
        measured = measured_from(store, predictions)
        report = Report(figures_of(measured, about), measured)
        if out is None:
            return report.figures, None
        source.fetch_images(dataset, dataset.frames, spec.modality)
        return report.figures, report.write(out)


def _source_and_spec(identity: Mapping[str, Any], where: str) -> tuple[SplitSource, ModelSpec]:
    """What a manifest says of the frames and the model."""
    try:
        source, spec = SplitSource(**identity["source"]), ModelSpec.from_dict(identity["spec"])
        known = isinstance(identity["labels_sha256"], str) and isinstance(identity["about"], dict)
    except (LookupError, TypeError, ValueError) as error:
        raise JobError(f"{where}: not the shards of an evaluation ({error!r:.100})") from error
    certain = type(source.certain_m) in (int, float, NoneType)
    if not (known and certain and isinstance(source.data, str) and source.split in SPLITS):
        raise JobError(f"{where}: not the shards of an evaluation, expected its source and labels")
    return source, spec


def _record(prediction: FramePrediction) -> dict[str, Any]:
    """A prediction as JSON values, which keep every bit."""
    keypoints = prediction.keypoints
    return {
        "boxes": prediction.boxes.tolist(),
        "scores": prediction.scores.tolist(),
        "keypoints": None if keypoints is None else keypoints.tolist(),
        "masks": prediction.masks,
    }


def read_predictions(content: bytes, where: object) -> list[FramePrediction]:
    """Read the predictions that a shard wrote.

    Args:
        content: Content of a part.
        where: Where the part is, for messages.

    Raises:
        JobError: If it holds other values.
    """
    try:
        return [_prediction(record) for record in json.loads(content)]
    except (ValueError, LookupError, TypeError, ArithmeticError, RecursionError) as error:
        raise JobError(
            f"{where}: a part holds no predictions ({error!r:.100}), expected what a shard wrote"
        ) from error


def _prediction(record: dict[str, Any]) -> FramePrediction:
    """Make a prediction of JSON values; ValueError or another plain error if they are none."""
    boxes = np.array(record["boxes"], np.float64).reshape(-1, 4)
    scores = np.array(record["scores"], np.float64)
    listed, masks = record["keypoints"], record["masks"]
    keypoints = None if listed is None else np.array(listed, np.float64).reshape(-1, 5, 3)
    if scores.shape != (len(boxes),) or not (
        np.isfinite(boxes).all() and np.isfinite(scores).all()
    ):
        raise ValueError("boxes and scores are no finite numbers of each tree")
    if keypoints is not None and (len(keypoints) != len(boxes) or not np.isfinite(keypoints).all()):
        raise ValueError("keypoints are no finite numbers of each tree")
    if masks is not None and (len(masks) != len(boxes) or not all(map(_is_mask, masks))):
        raise ValueError("masks are no run lengths of each tree")
    return FramePrediction(boxes, scores, keypoints, masks)


def _is_mask(mask: Any) -> bool:
    size = mask.get("size") if isinstance(mask, dict) else None
    return (
        isinstance(size, list)
        and [type(side) for side in size] == [int, int]
        and all(1 <= side <= current_limits().image_pixels for side in size)
        and size[0] * size[1] <= current_limits().image_pixels
        and isinstance(mask.get("counts"), str)
    )
