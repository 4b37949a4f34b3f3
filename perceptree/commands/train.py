"""`perceptree train`: train a detector on a dataset."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from basetree.program.console import print_json, tell
from basetree.program.options import expand_groups
from basetree.program.progress import counter
from basetree.program.quoting import quoted
from perceptree.commands.options import Json
from perceptree.commands.progress import TrainingBar, say
from perceptree.commands.train_options import (
    DataOptions,
    ModelOptions,
    ScheduleOptions,
    StartOptions,
    train_settings,
)
from perceptree.settings.training import Engine

if TYPE_CHECKING:
    from perceptree.training import TrainReport


@expand_groups
def train(
    data: Annotated[Path, typer.Argument(help="Folder of a dataset in any supported layout.")],
    out: Annotated[Path, typer.Option(help="Folder of the run; an interrupted run is resumed.")],
    *,
    learned: DataOptions,
    model: ModelOptions,
    start: StartOptions,
    schedule: ScheduleOptions,
    engine: Engine,
    as_json: Json = False,
) -> None:
    """Train a detector from random or published weights; keeps the best by box AP on val."""
    # What needs no torch comes first, as loading it takes seconds.
    model.check()
    learned.check(data, start)
    init = start.weights()

    from perceptree.training import Preparing, train_while_simulating
    from perceptree.training import train as run_training
    from perceptree.training.branching import BranchedRun

    branched = None if start.branch is None else BranchedRun.read(_settings_of(start.branch, out))
    spec = model.spec(init, branched)
    settings = train_settings(spec, learned, start, schedule, branched)
    # Only one of torchrun's processes prints.
    is_main = os.environ.get("RANK", "0") == "0"
    shown = is_main and not as_json
    cached = counter("caching frames", shown=shown)
    preparing = Preparing(cached, say if is_main else lambda line: None)
    if branched is not None:
        rate = settings.learning_rate
        last = settings.final_rate_share * rate
        preparing.say(f"branch of {branched.folder}: the rate falls from {rate:g} to {last:g}")
    told = TrainingBar(shown)
    if learned.simulate is None:
        source, heads = learned.source(data), start.init_heads
        report = run_training(
            spec, settings, source, out, told, init, engine, start.branch, preparing, heads
        )
    else:
        goal = learned.simulate
        report = train_while_simulating(
            spec, settings, data, goal, out, told, init, engine, preparing
        )
    if is_main:
        _print_result(report, data, as_json)


def _settings_of(branch: Path, out: Path) -> Path:
    """The folder that tells a branch its settings: that of the run, or once it is gone its own."""
    from perceptree.training.state import STATE_NAME

    is_gone = not (branch / STATE_NAME).is_file()
    return out if is_gone and (out / STATE_NAME).is_file() else branch


def _print_result(report: TrainReport, data: Path, as_json: bool) -> None:
    metrics = report.metrics
    if as_json:
        print_json(
            {
                "schema": "perceptree.train/1",
                "checkpoint": str(report.checkpoint),
                "steps": report.steps,
                "elapsed_s": round(report.elapsed_s, 1),
                "val": metrics.to_dict(),
            }
        )
        return
    tell(f"val: box AP {metrics.box_ap:.1f}, AP50 {metrics.box_ap50:.1f}")
    tell(f"{report.checkpoint}")
    tell(
        f"next: edgetree export {quoted(report.checkpoint)} --data {quoted(data)} --out model.onnx"
    )
