"""``perceptree eval``: evaluate a checkpoint on a split of a dataset."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from perceptree.commands.data import EntireTree, Fold
from perceptree.errors import DatasetError

if TYPE_CHECKING:
    from perceptree.evaluation import Report
    from perceptree.models import ModelSpec

_BATCH = 4


def evaluate(
    checkpoint: Annotated[Path, typer.Argument(help="A .safetensors checkpoint.")],
    data: Annotated[Path, typer.Argument(help="Folder of a dataset.")],
    split: Annotated[str, typer.Option(help="train, val or test.")] = "test",
    fold: Fold = None,
    entire_tree: EntireTree = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for report.json and report.html, with plots and images."),
    ] = None,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Evaluate a checkpoint: COCO AP, errors in pixels, results by distance, weather and more."""
    from perceptree.data import SPLITS, FrameStore, read_dataset
    from perceptree.evaluation import (
        About,
        make_report,
        on_device,
        predict_with,
        report_folder,
    )
    from perceptree.models import load_checkpoint

    if split not in SPLITS:
        raise DatasetError(f"--split is {split!r}: expected one of {', '.join(SPLITS)}")
    model, record = load_checkpoint(checkpoint)
    model = on_device(model, device)
    dataset = read_dataset(data, split, fold, entire_tree)
    store = FrameStore(dataset.frames, model.spec)
    if out is not None:
        report_folder(out)
    about = About(_about(checkpoint, model.spec, record), str(data), split, dataset.notes)
    shown = sys.stderr.isatty() and not as_json
    with typer.progressbar(
        length=len(store), label="evaluating", file=sys.stderr, hidden=not shown
    ) as bar:
        report = make_report(predict_with(model), store, about, _BATCH, bar.update)
    _print_result(report, None if out is None else report.write(out), as_json)


def _print_result(report: Report, page: Path | None, as_json: bool) -> None:
    from perceptree.evaluation import summary_lines

    if as_json:
        typer.echo(json.dumps(report.figures, allow_nan=False))
        return
    for line in summary_lines(report.figures):
        typer.echo(line)
    hint = "next: add --out FOLDER for plots and images"
    typer.echo(hint if page is None else f"open: {page}")


def _about(checkpoint: Path, spec: ModelSpec, record: dict[str, Any]) -> dict[str, Any]:
    training = record.get("training")
    return {
        "name": checkpoint.stem,
        "path": str(checkpoint),
        "kind": "checkpoint",
        "backbone": spec.backbone,
        "modality": spec.modality,
        "precision": "float32",
        "input_px": [spec.width, spec.height],
        "detections": spec.detections,
        "lowest_score": spec.score_threshold,
        "training": training if isinstance(training, dict) else None,
    }
