"""``perceptree eval``: how good a checkpoint is on a dataset's split."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from perceptree.errors import DatasetError


def evaluate(
    checkpoint: Annotated[Path, typer.Argument(help="A .safetensors checkpoint.")],
    data: Annotated[Path, typer.Argument(help="Folder of a dataset.")],
    split: Annotated[str, typer.Option(help="train, val or test.")] = "test",
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """COCO AP of boxes, masks and keypoints, and keypoint errors in pixels."""
    from perceptree.data import SPLITS, FrameStore, read_split
    from perceptree.evaluation import evaluate as run_evaluation
    from perceptree.evaluation import predict_with
    from perceptree.models import load_checkpoint

    if split not in SPLITS:
        raise DatasetError(f"--split is {split!r}: expected one of {', '.join(SPLITS)}")
    model, _ = load_checkpoint(checkpoint)
    store = FrameStore(read_split(data, split), model.spec)
    shown = sys.stderr.isatty() and not as_json
    with typer.progressbar(
        length=len(store), label="evaluating", file=sys.stderr, hidden=not shown
    ) as bar:
        metrics = run_evaluation(predict_with(model), store, batch=4, progress=bar.update)
    if as_json:
        typer.echo(json.dumps(metrics.to_dict()))
        return
    typer.echo(f"{metrics.frames} frames, {metrics.trees} trees")
    for name, ap, ap50 in (
        ("boxes", metrics.box_ap, metrics.box_ap50),
        ("masks", metrics.mask_ap, metrics.mask_ap50),
        ("keypoints", metrics.keypoint_ap, metrics.keypoint_ap50),
    ):
        typer.echo(f"{name:9} " + ("-" if ap is None else f"AP {ap:5.1f}  AP50 {ap50:5.1f}"))
    for name, error_px in metrics.keypoint_error_px.items():
        typer.echo(f"{name:15} median error {error_px:.1f} px")
