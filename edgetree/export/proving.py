"""The proof that comes with a file: its detections beside its model's, and the AP of both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from edgetree.evaluate import predict_with_file
from edgetree.export.frames import InputRules, find_frames, probe_frames, read_frames
from edgetree.export.parity import (
    UNMATCHED_FRAMES,
    Arrays,
    ParityFailed,
    ParityReport,
    compare_frames,
    limits_of,
)
from edgetree.export.prepare import UNTRAINED
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.session import InferenceSession

if TYPE_CHECKING:
    from perceptree.models import TreeRCNN

__all__ = ["Evidence", "Say", "evidence_in", "prove"]

PARITY_FRAMES: Final = 20
AP_FRAMES: Final = 100

Frames = Mapping[str, NDArray[np.uint8]]
Say = Callable[[str], None]


class Evidence:
    """What file and model are compared on.

    Attributes:
        frames: prepared frames by name, none of them traced or calibrated on.
        paths: where they were read from; empty for frames of the package.
        labelled: a data set whose labelled frames give the AP, or None.
    """

    def __init__(self, frames: Frames, paths: list[Path], labelled: Path | None) -> None:
        self.frames, self.paths, self.labelled = frames, paths, labelled


def evidence_in(data: Path, rules: InputRules) -> Evidence:
    """Frames of a folder, those of its test split where it has one.

    Raises:
        InputError: no frames there.
    """
    paths = find_frames(data, rules.modality, PARITY_FRAMES, unseen=True)
    images = read_frames(paths, rules)
    return Evidence(dict(zip((p.stem for p in paths), images, strict=True)), paths, data)


def prove(
    model: TreeRCNN, session: InferenceSession, manifest: Manifest, evidence: Evidence, say: Say
) -> ParityReport:
    """Compare file and model on the evidence and on the frames of odd days.

    Raises:
        ParityFailed: they differ by more than the limits of the file's precision.
    """
    rules = InputRules.of(model.spec)
    real = np.stack(list(evidence.frames.values()))
    probes = probe_frames(rules, real)
    frames = {**evidence.frames, **probes}
    trained = manifest.training_data != UNTRAINED
    batch = manifest.input.batch_sizes[0]
    say(f"comparing on {len(frames)} frames, {batch} at a time")
    shown = compare_frames(
        lambda images: _answer(model, manifest, images),
        lambda images: session.run({manifest.input.name: images}),
        frames,
        manifest.precision,
        manifest.thresholds.score,
        batch,
        UNMATCHED_FRAMES if trained else tuple(probes),
    )
    limits = limits_of(manifest.precision, trained=trained)
    report = ParityReport(manifest.precision, shown, limits=limits)
    if report.limits.ap_loss is not None and evidence.labelled is not None:
        report = _with_average_precision(report, model, session, manifest, evidence.labelled, say)
    faults = report.faults()
    if faults:
        more = f" and {len(faults) - 2} more" if len(faults) > 2 else ""
        raise ParityFailed(
            f"the file does not find what the checkpoint finds: {'; '.join(faults[:2])}{more}",
            report,
        )
    return report


def _answer(model: TreeRCNN, manifest: Manifest, images: NDArray[np.uint8]) -> Arrays:
    """What the model finds, as the file's outputs."""
    import torch

    with torch.inference_mode():
        found = model.detect(torch.from_numpy(images))._asdict()
    return {name: found[name].numpy() for name in manifest.output_names}


def _with_average_precision(
    report: ParityReport,
    model: TreeRCNN,
    session: InferenceSession,
    manifest: Manifest,
    data: Path,
    say: Say,
) -> ParityReport:
    """The report with the AP of both, where ``data`` has labels of frames not trained on."""
    from perceptree.data import FrameStore, read_split
    from perceptree.evaluation import evaluate, predict_with

    split = next((name for name in ("test", "val") if (data / f"{name}_RGB.json").is_file()), None)
    if split is None:
        return report
    store = FrameStore(read_split(data, split)[:AP_FRAMES], model.spec)
    say(f"evaluating on {len(store)} labelled frames")
    batch = manifest.input.batch_sizes[0]
    before = evaluate(predict_with(model), store)
    after = evaluate(predict_with_file(session, manifest), store, batch)
    both = {
        name: (getattr(before, f"{name}_ap"), getattr(after, f"{name}_ap"))
        for name in ("box", "mask", "keypoint")
    }
    measured = {name: pair for name, pair in both.items() if None not in pair}
    return replace(report, average_precision=measured)
