"""How good a model file is on labelled frames: perceptree's measures, of what onnxruntime says."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from edgetree.errors import InputError, MissingDependency
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.session import InferenceSession

if TYPE_CHECKING:
    from perceptree.data import FrameStore
    from perceptree.evaluation import Predict, RawDetections, Report

__all__ = ["evaluate_file", "predict_with_file", "summary_of"]


def evaluate_file(
    detector: TreeDetector,
    about: dict[str, Any],
    data: Path,
    split: str,
    fold: int | None = None,
    entire_tree: bool = False,
    progress: Callable[[int, int], None] = lambda done, frames: None,
) -> Report:
    """The report of a model file, by the code that gives a checkpoint's.

    Args:
        detector: of the file; its score threshold plays no part.
        about: what is known of the model, JSON-ready.
        data: folder of a data set.
        split: "train", "val" or "test".
        fold: which fold, where there are several.
        entire_tree: the labels of entire trees, where there are both.
        progress: gets how many frames were done since its last call, and how many there are.

    Raises:
        InputError: another split.
        MissingDependency: torch or another part of the training set-up is not installed.
        perceptree.errors.DatasetError: the data are missing, broken or without trees.
    """
    _need_training_setup()
    from perceptree.data import SPLITS, read_dataset
    from perceptree.evaluation import About, make_report

    if split not in SPLITS:
        raise InputError(f"--split is {split!r}: expected one of {', '.join(SPLITS)}")
    manifest = detector.manifest
    dataset = read_dataset(data, split, fold, entire_tree)
    store = _frames_for(manifest, dataset.frames)
    return make_report(
        predict_with_file(detector.session, manifest),
        store,
        About(_about(manifest, about), str(data), split, dataset.notes),
        manifest.input.batch_sizes[0],
        lambda done: progress(done, len(store)),
    )


def predict_with_file(session: InferenceSession, manifest: Manifest) -> Predict:
    """A file as perceptree's measures ask for it: uint8 batches of at most its own size."""
    from perceptree.evaluation import RawDetections

    batch = manifest.input.batch_sizes[0]

    def predict(images: NDArray[np.uint8]) -> RawDetections:
        filled = np.concatenate([images, images[:1].repeat(batch - len(images), axis=0)])
        found = session.run({manifest.input.name: filled})
        kept = {name: values[: len(images)] for name, values in found.items()}
        return RawDetections(
            kept["boxes"],
            kept["scores"],
            kept.get("keypoints"),
            kept.get("masks"),
            kept["num_detections"],
        )

    return predict


def summary_of(report: Report) -> list[str]:
    """The lines that a person at the terminal reads."""
    from perceptree.evaluation import summary_lines

    return list(summary_lines(report.figures))


def _frames_for(manifest: Manifest, frames: list[Any]) -> FrameStore:
    """The frames, fitted into the file's input as into that of a model in training."""
    from perceptree.data import FrameStore
    from perceptree.models import make_spec

    spec = make_spec(
        "edge-n",
        "rgb" if manifest.modality == "rgb" else "depth",
        height=manifest.input.height,
        width=manifest.input.width,
    )
    encoding = manifest.depth_encoding
    spec = dataclasses.replace(
        spec,
        pad_value=manifest.resize.pad_value,
        depth_encoding=None if encoding is None else dict(encoding),
    )
    return FrameStore(frames, spec)


def _about(manifest: Manifest, about: dict[str, Any]) -> dict[str, Any]:
    return {
        **about,
        "kind": "ONNX file",
        "backbone": manifest.backbone,
        "input_px": [manifest.input.width, manifest.input.height],
        "lowest_score": manifest.thresholds.score,
        "weights_sha256": manifest.weights_sha256,
        "training": manifest.training_data,
    }


def _need_training_setup() -> None:
    try:
        import perceptree.evaluation  # noqa: F401
    except ImportError as error:
        raise MissingDependency(
            f"{error}: labelled data are read by the training set-up, install edgetree[train]"
        ) from error
