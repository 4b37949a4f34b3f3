"""`perceptree eval`: evaluate a checkpoint on a split of a dataset."""

from __future__ import annotations

import os
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from basetree.errors import SettingsError
from basetree.program.console import print_found
from basetree.program.options import expand_groups
from basetree.program.progress import progress
from perceptree.commands.options import (
    Checkpoint,
    CrowdsAsTrees,
    Device,
    EntireTree,
    Fold,
    Json,
    Split,
    check_split,
)
from perceptree.commands.shards import ShareOptions, location, print_shard

if TYPE_CHECKING:
    from perceptree.evaluation.shards import SplitSource
    from perceptree.models import ModelSpec
    from perceptree.models.branches import Inputs

_BATCH = 4


@dataclass(frozen=True)
class SplitOptions:
    """The frames of a dataset to evaluate on, and which of their trees count."""

    split: Split = "test"
    fold: Fold = None
    entire_tree: EntireTree = False
    certain: Annotated[
        float | None,
        typer.Option(
            help="Distance in metres beyond which labelled trees are ignored: they count neither"
            " as found nor as missed, nor as false positives. Recall is given with them, too."
        ),
    ] = None
    crowds_as_trees: CrowdsAsTrees = False


@expand_groups
def evaluate(
    checkpoint: Checkpoint,
    data: Annotated[Path, typer.Argument(help="Folder of a dataset; with --shards also a URL.")],
    *,
    frames: SplitOptions,
    inputs: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Which images a model of colour and depth is given: both, colour or depth.",
        ),
    ] = "both",
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for report.json and report.html, with plots and images."),
    ] = None,
    device: Device = "cpu",
    shards: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER|URL",
            help="Where finished parts are kept, for --shard and --ray: a folder, or an object"
            " store such as s3://bucket/folder.",
        ),
    ] = None,
    share: ShareOptions,
    as_json: Json = False,
) -> None:
    """Evaluate a checkpoint: COCO AP, errors in pixels, results by distance, weather and more."""
    from perceptree.data import FrameStore, read_dataset
    from perceptree.evaluation import (
        About,
        make_report,
        on_device,
        predict_with,
        report_folder,
    )
    from perceptree.evaluation.shards import SplitSource
    from perceptree.models import load_checkpoint
    from perceptree.models.branches import pruned

    check_split(frames.split)
    if inputs not in ("both", "colour", "depth"):
        raise SettingsError(f"--inputs is {inputs!r}: expected both, colour or depth")
    if shards is not None or share.is_given:
        if inputs != "both":
            other = "--shards" if shards is not None else "--shard or --ray"
            raise SettingsError(f"--inputs is given with {other}: expected one of them")
        source = SplitSource(location(data), *astuple(frames))
        _in_shards(checkpoint, source, device, shards, share, out, as_json)
        return
    model, record = load_checkpoint(checkpoint)
    model = on_device(pruned(model, cast("Inputs", inputs)), device)
    dataset = read_dataset(data, *astuple(frames))
    store = FrameStore(dataset.frames, model.spec)
    if out is not None:
        report_folder(out)
    about = About(
        _about(checkpoint, model.spec, record),
        str(data),
        frames.split,
        dataset.notes,
        frames.certain,
    )
    with progress("evaluating", len(store), shown=not as_json) as bar:
        report = make_report(predict_with(model), store, about, _BATCH, bar.update)
    print_report(report.figures, None if out is None else report.write(out), as_json)


def _in_shards(
    checkpoint: Path,
    source: SplitSource,
    device: str,
    shards: Path | None,
    share: ShareOptions,
    out: Path | None,
    as_json: bool,
) -> None:
    """Evaluate a shard of the frames; with Ray, or without --shard, all of them."""
    from basetree.jobs import Progress, is_url, read_manifests, run_shard
    from perceptree.evaluation import report_folder
    from perceptree.evaluation.shards import EvalWork, eval_job, labels_sha256, merge_evaluation
    from perceptree.models import load_checkpoint

    chosen = share.chosen()
    if shards is None:
        raise SettingsError("--shards is missing: expected a folder or URL to keep parts in")
    if share.shard is not None and out is not None:
        raise SettingsError("--out given with --shard: expected it with `perceptree merge`")
    if share.ray is not None and device != "cpu":
        raise SettingsError(f"--device is {device} with --ray: expected cpu")
    if out is not None:
        report_folder(out)
    model, record = load_checkpoint(checkpoint)
    seen = source
    if share.ray is not None and not is_url(source.data):
        seen = replace(source, data=os.path.abspath(source.data))
    with seen.opened() as dataset:
        labels = labels_sha256(dataset)
    threads = None if share.ray is None else 1
    work = EvalWork(checkpoint.read_bytes(), seen, labels, device, threads)
    store = share.store(shards)
    job = eval_job(store, source, work, model.spec, _about(checkpoint, model.spec, record))
    bar = Progress("evaluating", threads or os.cpu_count() or 1)
    if share.ray is not None:
        from basetree.jobs.on_ray import RayEngine

        with RayEngine(share.ray) as engine:
            engine.run(job, work, bar)
    else:
        run_shard(job, work, chosen, bar)
    if share.shard is not None:
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

    hint = "next: add --out FOLDER for plots and images"
    last = hint if page is None else f"open: {page}"
    print_found(as_json, lambda: figures, lambda: [*summary_lines(figures), last])


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
