"""Training on a simulated dataset while it grows: one machine draws frames and learns from them.

A training goes on in stages, each in a folder of its own. When the dataset has grown to the next
size, the stage saves its state and the next one branches from it onto the larger dataset.
"""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch

from perceptree.data import read_dataset
from perceptree.errors import DatasetError, SettingsError
from perceptree.models import ModelSpec
from perceptree.training.run import train
from perceptree.training.settings import Engine, TrainSettings
from perceptree.training.source import Preparing
from perceptree.training.starting import Init
from perceptree.training.state import STATE_NAME, read_state
from perceptree.training.trainer import Progress, Status, TrainReport

_SETTINGS_FILE = "settings.json"
_GROWTH = 2
_SECONDS = 60.0
_END_S = 30.0


class _Grown(KeyboardInterrupt):
    """The simulation is over: the stage stops as for a Ctrl-C, its state saved."""


def train_while_simulating(
    spec: ModelSpec,
    settings: TrainSettings,
    data: Path,
    frames: int,
    out: Path,
    progress: Progress = lambda status: None,
    init: Init | None = None,
    engine: Engine | None = None,
    preparing: Preparing | None = None,
) -> TrainReport:
    """Train on a dataset of ``perceptree synth`` while it is extended to ``frames`` frames.

    The dataset doubles from stage to stage, ``out/stage-1`` and so on; half of the cores draw
    frames. Training ends after ``settings.minutes`` over all stages, and simulating with it.
    Started again, both go on.

    Raises what :func:`train` raises, SettingsError for settings that do not allow it, and
    DatasetError for a folder that is no simulated dataset, or where simulating fails.
    """
    engine = engine or Engine()
    preparing = preparing or Preparing()
    _check(settings)
    while True:
        stages = _stages(out)
        spent_s = sum(_elapsed_s(stage) for stage in stages)
        left = (settings.minutes or 0.0) - spent_s / _SECONDS
        if left <= 0:
            raise SettingsError(
                f"minutes is {settings.minutes:g}: {out} has been trained for as long; expected"
                " more to go on"
            )
        stage = out / f"stage-{len(stages) + 1}"
        goal = min(frames, _GROWTH * _frames_in(data))
        preparing.say(f"{stage.name}: {_frames_in(data)} frames, simulating up to {goal}")
        with _simulating(data, goal) as grown:
            try:
                return train(
                    spec,
                    dataclasses.replace(settings, minutes=left),
                    data,
                    stage,
                    _until(grown, progress, spent_s, settings.minutes or 0.0),
                    None if stages else init,
                    engine,
                    stages[-1] if stages else None,
                    preparing,
                )
            except _Grown as stop:
                if grown is not None and grown.returncode:
                    raise DatasetError(_last_line(grown)) from stop


def _check(settings: TrainSettings) -> None:
    if settings.minutes is None:
        raise SettingsError(
            "minutes is not given: expected when to end, --simulate counts no steps"
        )
    if settings.looks_ahead:
        raise SettingsError(
            f"schedule is {settings.schedule}: a training that simulates meanwhile has stages, "
            "expected constant or steps"
        )
    if int(os.environ.get("WORLD_SIZE", "1")) > 1:
        raise SettingsError(
            "several processes cannot train while one simulates: expected one, or a finished"
            " dataset"
        )


def _stages(out: Path) -> list[Path]:
    """The folders of the stages so far."""
    found: list[Path] = []
    while (folder := out / f"stage-{len(found) + 1}") and (folder / STATE_NAME).exists():
        found.append(folder)
    return found


def _elapsed_s(stage: Path) -> float:
    return float(read_state(stage / STATE_NAME, {})["elapsed_s"])


def _frames_in(data: Path) -> int:
    return sum(len(read_dataset(data, split).frames) for split in ("train", "val", "test"))


def _until(
    grown: subprocess.Popen[str] | None, progress: Progress, spent_s: float, minutes: float
) -> Progress:
    """``progress`` counted over all stages, which stops the stage when the dataset has grown."""

    def tell(status: Status) -> None:
        elapsed_s = spent_s + status.elapsed_s
        done = min(1.0, elapsed_s / (minutes * _SECONDS))
        progress(dataclasses.replace(status, done=done, elapsed_s=elapsed_s))
        if grown is not None and done < 1 and grown.poll() is not None:
            raise _Grown

    return tell


def _last_line(simulation: subprocess.Popen[str]) -> str:
    lines = (simulation.communicate()[1] or "").strip().splitlines()
    reason = lines[-1].removeprefix("perceptree: ") if lines else "no reason told"
    return f"simulating failed: {reason}"


@contextmanager
def _simulating(data: Path, frames: int) -> Iterator[subprocess.Popen[str] | None]:
    """A process that extends ``data`` to ``frames`` meanwhile; None where it holds as many."""
    if _frames_in(data) >= frames:
        yield None
        return
    cores = os.cpu_count() or 1
    threads = torch.get_num_threads()
    simulation = _start_simulating(data, frames, max(1, cores // 2))
    torch.set_num_threads(max(1, min(threads, cores - cores // 2)))
    try:
        yield simulation
    finally:
        torch.set_num_threads(threads)
        simulation.terminate()
        try:
            simulation.communicate(timeout=_END_S)
        except subprocess.TimeoutExpired:
            simulation.kill()


def _start_simulating(data: Path, frames: int, workers: int) -> subprocess.Popen[str]:
    path = data / _SETTINGS_FILE
    try:
        record = json.loads(path.read_text("utf-8"))
        seed, image_format = int(record["seed"]), str(record["files"]["image_format"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DatasetError(
            f"{path}: expected the settings of a dataset of perceptree synth, which is extended"
        ) from error
    options = {
        "--out": data,
        "--settings": path,
        "--seed": seed,
        "--image-format": image_format,
        "--frames": frames,
        "--workers": workers,
    }
    command = [sys.executable, "-m", "perceptree", "synth", "--json"]
    for name, value in options.items():
        command += [name, str(value)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
