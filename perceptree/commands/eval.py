"""``perceptree eval``: evaluate a checkpoint on a split of a dataset."""

from __future__ import annotations

import dataclasses
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from basetree.errors import SettingsError
from perceptree.commands.data import EntireTree, Fold
from perceptree.commands.shards import (
    RayOption,
    ShardOption,
    ShardsOption,
    chosen_shard,
    location,
    opened_store,
    print_shard,
)
from perceptree.errors import DatasetError

if TYPE_CHECKING:
    from perceptree.evaluation.shards import SplitSource
    from perceptree.models import ModelSpec

_BATCH = 4


def evaluate(
    checkpoint: Annotated[Path, typer.Argument(help="A .safetensors checkpoint.")],
    data: Annotated[Path, typer.Argument(help="Folder of a dataset; with --shards also a URL.")],
    split: Annotated[str, typer.Option(help="train, val or test.")] = "test",
    fold: Fold = None,
    entire_tree: EntireTree = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for report.json and report.html, with plots and images."),
    ] = None,
    certain: Annotated[
        float | None,
        typer.Option(
            help="Distance in metres beyond which labelled trees are ignored: they count neither"
            " as found nor as missed, nor as false positives. Recall is given with them, too."
        ),
    ] = None,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    shards: ShardsOption = None,
    shard: ShardOption = None,
    ray: RayOption = None,
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
    from perceptree.evaluation.shards import SplitSource
    from perceptree.models import load_checkpoint

    if split not in SPLITS:
        raise DatasetError(f"--split is {split!r}: expected one of {', '.join(SPLITS)}")
    if shards is not None or shard is not None or ray is not None:
        where = SplitSource(location(data), split, fold, entire_tree, certain)
        _in_shards(checkpoint, where, device, (shards, shard, ray), out, as_json)
        return
    model, record = load_checkpoint(checkpoint)
    model = on_device(model, device)
    dataset = read_dataset(data, split, fold, entire_tree, certain)
    store = FrameStore(dataset.frames, model.spec)
    if out is not None:
        report_folder(out)
    about = About(_about(checkpoint, model.spec, record), str(data), split, dataset.notes, certain)
    shown = sys.stderr.isatty() and not as_json
    with typer.progressbar(
        length=len(store), label="evaluating", file=sys.stderr, hidden=not shown
    ) as bar:
        report = make_report(predict_with(model), store, about, _BATCH, bar.update)
    print_report(report.figures, None if out is None else report.write(out), as_json)


def _in_shards(
    checkpoint: Path,
    source: SplitSource,
    device: str,
    options: tuple[Path | None, str | None, str | None],
    out: Path | None,
    as_json: bool,
) -> None:
    """Evaluate a shard of the frames; with Ray, or without --shard, all of them."""
    from basetree.jobs import Progress, is_url, read_manifests, run_shard
    from perceptree.evaluation import report_folder
    from perceptree.evaluation.shards import EvalWork, eval_job, labels_sha256, merge_evaluation
    from perceptree.models import load_checkpoint

    shards, shard, ray = options
    chosen = chosen_shard(shard, ray)
    if shards is None:
        raise SettingsError("--shards is missing: expected a folder or URL to keep parts in")
    if shard is not None and out is not None:
        raise SettingsError("--out given with --shard: expected it with `perceptree merge`")
    if ray is not None and device != "cpu":
        raise SettingsError(f"--device is {device} with --ray: expected cpu")
    if out is not None:
        report_folder(out)
    model, record = load_checkpoint(checkpoint)
    seen = source
    if ray is not None and not is_url(source.data):
        seen = dataclasses.replace(source, data=os.path.abspath(source.data))
    with seen.opened() as dataset:
        labels = labels_sha256(dataset)
    threads = None if ray is None else 1
    work = EvalWork(checkpoint.read_bytes(), seen, labels, device, threads)
    store = opened_store(shards, ray)
    job = eval_job(store, source, work, model.spec, _about(checkpoint, model.spec, record))
    progress = Progress("evaluating", threads or os.cpu_count() or 1)
    if ray is not None:
        from basetree.jobs.on_ray import RayEngine

        with RayEngine(ray) as engine:
            engine.run(job, work, progress)
    else:
        run_shard(job, work, chosen, progress)
    if shard is not None:
        print_shard(store, chosen, as_json)
        return
    print_report(*merge_evaluation(read_manifests([store], (job.kind,)), out), as_json)


def print_report(figures: dict[str, Any], page: Path | None, as_json: bool) -> None:
    """Print the results of an evaluation.

    Args:
        figures: The results.
        page: Page of the report, if there is one.
        as_json: Whether to print one JSON object.
    """
    from perceptree.evaluation import summary_lines

    if as_json:
        typer.echo(json.dumps(figures, allow_nan=False))
        return
    for line in summary_lines(figures):
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
