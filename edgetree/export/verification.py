"""Verify an ONNX file: compare its detections and average precision with those of its model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from basetree.arrays import UInt8
from basetree.counts import counted
from edgetree.evaluate import predict_with_file
from edgetree.export.build import output_names
from edgetree.export.comparison import UNMATCHED_FRAMES, Arrays, compare_frames
from edgetree.export.frames import ALONE, edge_case_frames, find_views, only, read_frames
from edgetree.export.limits import UNTRAINED_LIMITS, limits_of
from edgetree.export.parity import ParityFailed, ParityReport
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.input_images import by_input
from edgetree.runtime.session import InferenceSession

if TYPE_CHECKING:
    from perceptree.evaluation import Predict
    from perceptree.models import ModelSpec, TreeRCNN

_COMPARED_FRAMES: Final = 20
_AP_FRAMES: Final = 100
_NO_LABELS: Final = (
    "average precision not measured: no labelled frames; give --data a dataset with"
    " test_RGB.json or val_RGB.json"
)
_UNTRAINED: Final = (
    "trees not compared: scores of an untrained network change by rounding; its outputs were only"
    " checked for validity"
)

Say = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class VerificationFrames:
    """Frames on which a file and its model are compared.

    Attributes:
        images: Prepared frames by name, uint8 of the spec's `image_shape`.
        paths: Files that they were read from, of pairs those of colour; empty for samples of the
            package.
        dataset: Folder of a dataset whose labels may give the average precision, or None.
    """

    images: Mapping[str, UInt8]
    paths: tuple[Path, ...] = ()
    dataset: Path | None = None


def read_verification_frames(data: Path, spec: ModelSpec) -> VerificationFrames:
    """Read frames of a folder, of its test split if it has one.

    Args:
        data: a dataset or a folder of images.
        spec: Model with input size, padding and depth encoding.

    Raises:
        InputError: The folder has no frames.
    """
    views = find_views(data, spec.modality, _COMPARED_FRAMES, test_split=True)
    images = read_frames(views, spec)
    paths = [view[0] for view in views]
    stems = [path.stem for path in paths]
    names = [
        stem if stems.count(stem) == 1 else str(path)
        for stem, path in zip(stems, paths, strict=True)
    ]
    named = dict(zip(names, images, strict=True))
    return VerificationFrames(named, tuple(paths), data)


def verify(
    model: TreeRCNN,
    session: InferenceSession,
    manifest: Manifest,
    frames: VerificationFrames,
    say: Say,
    *,
    trained: bool = True,
) -> ParityReport:
    """Compare a file with its model on given frames and on edge cases.

    Args:
        model: The model.
        session: Inference session of the file.
        manifest: Manifest of the file.
        frames: The frames to compare on.
        say: Called with progress messages.
        trained: False for random weights. Then files in `float16` and `int8` have no limits,
            see `limits_of`.

    Raises:
        ParityFailed: They differ by more than the limits of the file's precision.
    """
    edge_cases = edge_case_frames(model.spec, np.stack(list(frames.images.values())))
    cases = {**frames.images, **edge_cases}
    images = {name: image for name, image in cases.items() if _is_for(image, manifest)}
    batch = manifest.input.batch_sizes[0]
    say(f"comparing on {counted(len(images), 'frame')}, {batch} at a time")
    compared = compare_frames(
        lambda batch_images: _detect(model, batch_images),
        lambda batch_images: session.run(by_input(batch_images, manifest)),
        images,
        manifest.precision,
        manifest.thresholds.score,
        batch,
        UNMATCHED_FRAMES if trained else tuple(edge_cases),
    )
    limits = limits_of(manifest.precision, trained=trained)
    report = ParityReport(manifest.precision, compared, limits=limits)
    if limits.ap_loss is not None:
        data = frames.dataset
        found = {} if data is None else _average_precision(model, session, manifest, data, say)
        report = replace(
            report, average_precision=found, not_checked=_unmeasured(model.spec, found)
        )
    elif limits == UNTRAINED_LIMITS:
        report = replace(report, not_checked=(_UNTRAINED,))
    faults = report.faults()
    if faults:
        more = f" and {len(faults) - 2} more" if len(faults) > 2 else ""
        raise ParityFailed(
            f"the file does not find what the checkpoint finds: {'; '.join(faults[:2])}{more}",
            report,
        )
    return report


def _is_for(image: UInt8, manifest: Manifest) -> bool:
    """Whether a prepared frame is for the model itself, and not for one of `Manifest.alone`."""
    shown = by_input(image[None], manifest).values()
    targets = manifest.graph_inputs.values()
    return not manifest.alone or all(
        (pixels != target.nothing).any() for pixels, target in zip(shown, targets, strict=True)
    )


def _detect(model: TreeRCNN, images: UInt8) -> Arrays:
    """Detections of the model, as arrays with the names of a file's outputs."""
    import torch

    with torch.inference_mode():
        found = model.detect(torch.from_numpy(images))._asdict()
    names = output_names(model.spec.masks, model.spec.keypoints)
    return {name: found[name].numpy() for name in names}


def _average_precision(
    model: TreeRCNN, session: InferenceSession, manifest: Manifest, data: Path, say: Say
) -> dict[str, tuple[float, float]]:
    """Average precision in percent of model and file, by kind of result.

    On the test split of a dataset, or else on its validation split. Empty without either. Of a
    model of colour and depth also with one of the two alone, but for combined files.
    """
    from perceptree.data import FrameStore, read_split
    from perceptree.evaluation import evaluate, predict_with

    split = next((name for name in ("test", "val") if (data / f"{name}_RGB.json").is_file()), None)
    if split is None:
        return {}
    store = FrameStore(read_split(data, split)[:_AP_FRAMES], model.spec)
    say(f"evaluating on {len(store)} labelled frames")
    batch = manifest.input.batch_sizes[0]
    found: dict[str, tuple[float, float]] = {}
    ways = ALONE if manifest.takes_both and not manifest.alone else ()
    for alone in ("", *ways):
        of_model = evaluate(_alone(predict_with(model), alone, model.spec), store)
        predict = _alone(predict_with_file(session, manifest), alone, model.spec)
        of_file = evaluate(predict, store, batch)
        for kind in ("box", "mask", "keypoint"):
            pair = getattr(of_model, f"{kind}_ap"), getattr(of_file, f"{kind}_ap")
            if None not in pair:
                found[f"{kind}, {alone} alone" if alone else kind] = pair
    return found


def _alone(predict: Predict, alone: str, spec: ModelSpec) -> Predict:
    """A prediction function that is shown one of colour and depth; "" for what there is."""
    return (lambda images: predict(only(alone, images, spec))) if alone else predict


def _unmeasured(spec: ModelSpec, measured: Mapping[str, object]) -> tuple[str, ...]:
    """One line for each average precision that could not be measured."""
    if not measured:
        return (_NO_LABELS,)
    heads = {"mask": spec.masks, "keypoint": spec.keypoints}
    return tuple(
        f"average precision of {name}s not measured: the labels hold no {name}s"
        for name, present in heads.items()
        if present and name not in measured
    )
