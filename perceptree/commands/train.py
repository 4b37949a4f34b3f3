"""``perceptree train``: train a detector on a dataset."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from perceptree.errors import SettingsError

if TYPE_CHECKING:
    from perceptree.training import Status


def train(
    data: Annotated[Path, typer.Argument(help="Folder of a dataset: train_RGB.json and so on.")],
    out: Annotated[Path, typer.Option(help="Folder of the run; one with a state is resumed.")],
    modality: Annotated[str, typer.Option(help="What the model sees: rgb or depth.")] = "depth",
    height: Annotated[int, typer.Option(help="Input height, px, a multiple of 32.")] = 384,
    width: Annotated[int, typer.Option(help="Input width, px, a multiple of 32.")] = 640,
    minutes: Annotated[float | None, typer.Option(help="End after so much training time.")] = None,
    steps: Annotated[int | None, typer.Option(help="End after so many steps.")] = None,
    batch: Annotated[int, typer.Option(help="Frames per step.")] = 8,
    learning_rate: Annotated[float, typer.Option(help="Peak of the schedule.")] = 1.5e-3,
    seed: Annotated[int, typer.Option(help="Of weights, order and augmentation.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Train the light detector from random weights; keeps the best by box AP on val."""
    from perceptree.models import light_spec
    from perceptree.training import TrainSettings
    from perceptree.training import train as run_training

    if modality not in ("rgb", "depth"):
        raise SettingsError(f"--modality is {modality!r}: expected rgb or depth")
    if minutes is None and steps is None:
        steps = 20_000
    spec = light_spec("rgb" if modality == "rgb" else "depth", height, width)
    settings = TrainSettings(
        steps=steps, minutes=minutes, batch=batch, learning_rate=learning_rate, seed=seed
    )
    report = run_training(spec, settings, data, out, _Bar(shown=not as_json))
    if as_json:
        result = {
            "checkpoint": str(report.checkpoint),
            "steps": report.steps,
            "elapsed_s": round(report.elapsed_s, 1),
            "val": report.metrics.to_dict(),
        }
        typer.echo(json.dumps(result))
        return
    metrics = report.metrics
    typer.echo(f"val: box AP {metrics.box_ap:.1f}, AP50 {metrics.box_ap50:.1f}")
    typer.echo(f"{report.checkpoint}")
    typer.echo(f"next: edgetree export {report.checkpoint} --data {data} --out model.onnx")


class _Bar:
    """Progress on stderr: a line that is rewritten on a terminal, now and then a new one else."""

    def __init__(self, shown: bool) -> None:
        self._shown, self._terminal = shown, sys.stderr.isatty()
        self._next_s = 0.0

    def __call__(self, status: Status) -> None:
        """Show where the training stands, at most once a second (a minute without terminal)."""
        if not self._shown or status.elapsed_s < self._next_s:
            return
        self._next_s = status.elapsed_s + (1.0 if self._terminal else 60.0)
        left_s = status.elapsed_s * (1 - status.done) / max(status.done, 1e-6)
        losses = " ".join(f"{name} {value:.3f}" for name, value in status.losses.items())
        line = (
            f"{status.done:4.0%} step {status.step}, {status.step / status.elapsed_s:.2f}/s,"
            f" {left_s / 60:.0f} min left | {losses}"
        )
        end = "\r" if self._terminal and status.done < 1 else "\n"
        sys.stderr.write(("\x1b[2K" if self._terminal else "") + line + end)
        sys.stderr.flush()
