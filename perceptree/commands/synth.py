"""``perceptree synth``: simulate a labelled dataset."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from perceptree.errors import SettingsError


def synth(
    out: Annotated[Path, typer.Option(help="Folder to write; one with the same settings resumes.")],
    frames: Annotated[int, typer.Option(help="How many frames.")] = 400,
    seed: Annotated[int, typer.Option(help="Decides every pixel, with the settings.")] = 0,
    width: Annotated[int, typer.Option(help="Image width, px.")] = 1280,
    height: Annotated[int, typer.Option(help="Image height, px.")] = 720,
    views: Annotated[int, typer.Option(help="Frames drawn of each scene.")] = 5,
    workers: Annotated[int | None, typer.Option(help="Processes; all cores without.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Simulate forest frames: colour, depth, masks, boxes, keypoints and true metres."""
    from perceptree.simulator import CameraSettings, SimulatorSettings, generate_dataset

    if workers is not None and workers < 1:
        raise SettingsError(f"--workers is {workers}: expected at least 1")
    settings = SimulatorSettings(
        camera=CameraSettings(width=width, height=height), views_per_scene=views
    )
    shown = sys.stderr.isatty() and not as_json
    with typer.progressbar(
        length=frames, label="simulating", file=sys.stderr, hidden=not shown
    ) as bar:

        def progress(done: int, _: int) -> None:
            bar.update(done - bar.pos)

        report = generate_dataset(out, frames, settings, seed, workers, progress)
    if as_json:
        typer.echo(json.dumps({**dataclasses.asdict(report), "directory": str(report.directory)}))
        return
    for split, count in report.frames.items():
        typer.echo(f"{split}: {count} frames, {report.trees[split]} trees")
    typer.echo(f"{report.directory}")
    typer.echo(f"next: perceptree train {report.directory} --out runs/depth --modality depth")
