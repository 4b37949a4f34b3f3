"""``perceptree train``: train a detector on a dataset."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from perceptree.errors import SettingsError

if TYPE_CHECKING:
    from perceptree.models import ModelSpec
    from perceptree.training import Init, Status, TrainReport

_DEFAULT_MODEL = "edge-n"
_PAPER_FREEZE_LEVEL = 2

_Model = Annotated[str | None, typer.Option(
    "--model",
    help="edge-n (the default), edge-s, edge-m, or the paper's r50, r101, x101-32x8d, x101-32x4d.",
)]  # fmt: skip
_Init = Annotated[str | None, typer.Option(
    "--init", help="Starting weights: imagenet, coco, or a checkpoint. Random without."
)]  # fmt: skip
_Modality = Annotated[str | None, typer.Option(
    help="What the model sees: depth (the default) or rgb."
)]  # fmt: skip
_Side = Annotated[int | None, typer.Option(help="Of the input, px; by default the model's own.")]
_Branch = Annotated[bool | None, typer.Option(help="Train the branch; by default the model's.")]
_FreezeLevel = Annotated[int | None, typer.Option(
    help="Keep the backbone up to stride 2**N as it is; by default 2 for the paper's backbones"
    " with starting weights, else 0."
)]  # fmt: skip
_FrozenNorms = Annotated[bool | None, typer.Option(
    "--frozen-norms/--trained-norms",
    help="Keep the backbone's batch norms as they are; by default for the paper's backbones"
    " with starting weights.",
)]  # fmt: skip


def train(
    data: Annotated[Path, typer.Argument(help="Folder of a dataset: train_RGB.json and so on.")],
    out: Annotated[Path, typer.Option(help="Folder of the run; one with a state is resumed.")],
    model: _Model = None,
    init: _Init = None,
    modality: _Modality = None,
    height: _Side = None,
    width: _Side = None,
    masks: _Branch = None,
    keypoints: _Branch = None,
    freeze_level: _FreezeLevel = None,
    frozen_norms: _FrozenNorms = None,
    minutes: Annotated[float | None, typer.Option(help="End after so much training time.")] = None,
    steps: Annotated[int | None, typer.Option(help="End after so many steps.")] = None,
    batch: Annotated[int, typer.Option(help="Frames per step.")] = 8,
    learning_rate: Annotated[float, typer.Option(help="Peak of the schedule.")] = 1.5e-3,
    seed: Annotated[int, typer.Option(help="Of weights, order and augmentation.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Train a detector from random or published weights; keeps the best by box AP on val."""
    from perceptree.models import PAPER_SAMPLING, SampleSettings
    from perceptree.training import TrainSettings
    from perceptree.training import train as run_training

    start = _starting_weights(init)
    named = {"height": height, "width": width, "masks": masks, "keypoints": keypoints}
    spec = _spec(model, modality, start, {k: v for k, v in named.items() if v is not None})
    paper = _is_paper(spec)
    kept = paper and start is not None
    if freeze_level is None:
        freeze_level = _PAPER_FREEZE_LEVEL if kept else 0
    settings = TrainSettings(
        steps=20_000 if minutes is None and steps is None else steps, minutes=minutes,
        batch=batch, learning_rate=learning_rate, seed=seed,
        freeze_level=freeze_level, frozen_norms=kept if frozen_norms is None else frozen_norms,
        sampling=PAPER_SAMPLING if paper else SampleSettings(),
    )  # fmt: skip
    report = run_training(spec, settings, data, out, _Bar(shown=not as_json), start)
    _tell(report, data, as_json)


def _starting_weights(init: str | None) -> Init | None:
    if init is None:
        return None
    if init == "imagenet":
        return "imagenet"
    if init == "coco":
        return "coco"
    if not Path(init).is_file():
        raise SettingsError(f"--init is {init!r}: expected imagenet, coco or a checkpoint file")
    return Path(init)


def _is_paper(spec: ModelSpec) -> bool:
    from perceptree.models import PAPER_PRESETS

    return spec.backbone in {preset["backbone"] for preset in PAPER_PRESETS.values()}


def _spec(
    model: str | None, modality: str | None, start: Init | None, changes: dict[str, Any]
) -> ModelSpec:
    """The preset's spec, or that of the starting file; ``changes`` are fields of ModelSpec."""
    from perceptree.models import load_checkpoint, make_spec

    if modality not in (None, "rgb", "depth"):
        raise SettingsError(f"--modality is {modality!r}: expected rgb or depth")
    named = make_spec(model or _DEFAULT_MODEL, "rgb" if modality == "rgb" else "depth", **changes)
    if not isinstance(start, Path):
        # Published weights learned with the stride in the 3x3 convolutions.
        return dataclasses.replace(named, stride_in_1x1=False) if start else named
    own = load_checkpoint(start)[0].spec
    if model is not None and named.backbone != own.backbone:
        raise SettingsError(
            f"--model is {model}, of backbone {named.backbone}, but {start} holds {own.backbone}: "
            "expected the same, or no --model"
        )
    if modality is not None and modality != own.modality:
        raise SettingsError(
            f"--modality is {modality}, but {start} is for {own.modality}: expected the same, "
            "or no --modality"
        )
    return dataclasses.replace(own, **changes)


def _tell(report: TrainReport, data: Path, as_json: bool) -> None:
    metrics = report.metrics
    if as_json:
        result = {
            "checkpoint": str(report.checkpoint),
            "steps": report.steps,
            "elapsed_s": round(report.elapsed_s, 1),
            "val": metrics.to_dict(),
        }
        typer.echo(json.dumps(result))
        return
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
