"""`perceptree calibrate-scores`: make the scores of a checkpoint probabilities."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from basetree.program.console import tell
from basetree.program.progress import progress
from perceptree.commands.options import Checkpoint, Split, check_checkpoint_name, check_split

if TYPE_CHECKING:
    from perceptree.data import FrameRecord

_BATCH = 4


def calibrate_scores(
    checkpoint: Checkpoint,
    data: Annotated[
        list[Path], typer.Argument(help="Folders of datasets that the network was not trained on.")
    ],
    out: Annotated[Path, typer.Option(help="Checkpoint to write.")],
    split: Split = "val",
    certain: Annotated[
        float | None,
        typer.Option(
            help="Ignore labelled trees beyond this distance in metres, in datasets that know it."
        ),
    ] = None,
    keep_level: Annotated[
        bool,
        typer.Option(
            "--keep-level",
            help="Let masks count in the scores, but keep them about as high as they were: for"
            " scores that were scaled, or chosen, on other data.",
        ),
    ] = False,
) -> None:
    """Scale the scores of a checkpoint, so that of those of 0.9 nine in ten are trees.

    All datasets count the same, whatever their size. The certainty of a tree's mask becomes part of
    its score, as far as that tells better how exact its box, mask and keypoints are. The scale
    becomes part of the checkpoint.
    """
    from perceptree.data import FrameStore
    from perceptree.evaluation import predict_frames, predict_with
    from perceptree.evaluation.reliability import (
        fit_scale,
        joined,
        reliability,
        scored_detections,
    )
    from perceptree.models import load_checkpoint, save_checkpoint

    check_split(split)
    check_checkpoint_name(out)
    model, record = load_checkpoint(checkpoint)
    stores = [FrameStore(_frames(folder, split, certain), model.spec) for folder in data]
    sets = []
    with progress("detecting", sum(map(len, stores))) as bar:
        for store in stores:
            found = []
            for prediction in predict_frames(predict_with(model), store, _BATCH):
                found.append(prediction)
                bar.update(1)
            sets.append(scored_detections(store.frames, found))
    scale = fit_scale(sets, keep_level)
    scaled = [one._replace(score=scale.apply(one)) for one in sets]
    errors = [reliability(joined(each))["expected_error"] for each in (sets, scaled)]
    model.box_head.scale_scores(scale.slope, scale.offset)
    weight = scale.slope * model.spec.mask_score_weight + scale.mask
    model.spec = replace(model.spec, mask_score_weight=weight)
    fitted = {
        "slope": scale.slope,
        "offset": scale.offset,
        "mask": scale.mask,
        "keep_level": keep_level,
        "data": ", ".join(folder.resolve().name for folder in data),
        "split": split,
        "detections": sum(len(one.score) for one in sets),
        "expected_error": errors,
    }
    save_checkpoint(out, model, {**record["training"], "score_calibration": fitted})
    for folder, before, after in zip(data, sets, scaled, strict=True):
        was, now = (reliability(one)["expected_error"] for one in (before, after))
        tell(
            f"{folder}: {len(before.score)} detections, mean difference of score and share of"
            f" trees {_shown(was)}, now {_shown(now)}"
        )
    tell(
        f"logit of the score: {scale.slope:.3f} times the former, {scale.offset:+.3f},"
        f" {scale.mask:+.3f} times that of the mask's certainty"
    )
    tell(f"checkpoint: {out}")


def _frames(folder: Path, split: str, certain_m: float | None) -> list[FrameRecord]:
    """The frames of a split, graded if its trees have distances."""
    from perceptree.data import read_dataset

    frames = read_dataset(folder, split).frames
    known = any("distance_m" in tree.truth for frame in frames for tree in frame.trees)
    if certain_m is None or not known:
        return frames
    return read_dataset(folder, split, certain_m=certain_m).frames


def _shown(error: float | None) -> str:
    return "unknown" if error is None else f"{error:.3f}"
