"""Accuracy of the models of a benchmark: from their cards, or measured on labelled frames."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from basetree.counts import counted

if TYPE_CHECKING:
    from edgetree.runtime.detector import TreeDetector
    from edgetree.runtime.providers import SessionSettings

_MOST_METRE_FRAMES = 100
_AVERAGE_PRECISIONS = {"box_ap": "boxes", "mask_ap": "masks", "keypoint_ap": "keypoints"}


def accuracy_of(
    path: Path, data: Path | None, split: str, session: SessionSettings | None = None
) -> dict[str, Any] | None:
    """The accuracy of a model file as JSON object; None if nothing is known.

    `source` and `frames` say where it is from; equal `frames` make two files comparable. The
    average precisions are in percent, the diameter's error is the median of the absolute error. On
    a dataset it is measured on up to a hundred frames, which `source` says if there are more.

    Args:
        path: The model file.
        data: a labelled dataset; None for the figures of the model's card.
        split: Split of the dataset.
        session: How to run the model on a dataset; the default settings if None.

    Raises:
        MissingPackage: a dataset is given, and torch or another package for training is missing.
        perceptree.errors.DatasetError: The dataset is missing or broken.
        EdgetreeError: The model cannot be opened.
    """
    return _of_card(path) if data is None else _of_data(path, data, split, session)


def _of_card(path: Path) -> dict[str, Any] | None:
    from basetree.errors import InputError
    from basetree.files.json import build
    from edgetree.catalogue import KnownModel
    from edgetree.model_file.card import MeasuredCard

    try:
        values = KnownModel(path.stem, path).card()
        card = None if values is None else build(MeasuredCard, values, "card")
    except InputError:  # the card of another file, or without these figures
        return None
    if card is None:
        return None
    test = card.test
    error_m = test.metres.quantities.diameter_m.median_abs
    return {
        "source": "the model's card",
        "frames": f"{counted(test.frames, 'frame')} of the preset test",
        **{
            name: getattr(test.average_precision, kind)
            for name, kind in _AVERAGE_PRECISIONS.items()
        },
        "diameter_error_mm": None if error_m is None else round(1000 * error_m, 1),
    }


def _of_data(path: Path, data: Path, split: str, session: SessionSettings | None) -> dict[str, Any]:
    from edgetree.evaluate import evaluate_file
    from edgetree.runtime.detector import TreeDetector
    from edgetree.runtime.session import OrtSession

    detector = TreeDetector(OrtSession(path, session))
    figures = evaluate_file(detector, {"name": path.stem}, data, split).figures
    found, frames = figures["average_precision"], figures["data"]["frames"]
    error_mm, source = _diameter_error_mm(detector, data, split), f"measured on {data}"
    if error_mm is not None and frames > _MOST_METRE_FRAMES:
        source += f", the diameter on {_MOST_METRE_FRAMES} of its frames"
    return {
        "source": source,
        "frames": f"{frames} frames, {_labels_sha256(data)}, split {split}",
        **{
            name: None if found[kind] is None else round(found[kind]["ap"], 2)
            for name, kind in _AVERAGE_PRECISIONS.items()
        },
        "diameter_error_mm": error_mm,
    }


def _diameter_error_mm(detector: TreeDetector, data: Path, split: str) -> float | None:
    """Median absolute error of the diameter on up to a hundred frames of a simulated dataset."""
    from basetree.errors import InputError
    from edgetree.demo.comparison import summarise
    from edgetree.demo.examine import examine
    from edgetree.demo.held_out import held_out_frames

    try:
        frames = held_out_frames(data, split, _MOST_METRE_FRAMES)
    except InputError:  # not a dataset of the simulator: no depth, camera or truth
        return None
    compared = [examine(detector, frame) for frame in frames]
    error_m = summarise(compared, "diameter_m").median_abs_error_m
    return None if error_m is None else round(1000 * error_m, 1)


def _labels_sha256(data: Path) -> str:
    """Short hash of the label files of a dataset."""
    digest = hashlib.sha256()
    for path in sorted(data.rglob("*.json")):
        if ".frame-cache" not in path.parts:
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]
