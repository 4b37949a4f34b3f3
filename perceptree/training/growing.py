"""Train on a simulated dataset while the same machine simulates more frames for it.

The training runs in stages, each in its own folder. When the dataset has reached the next size,
the stage saves its state, and the next stage branches from it with the larger dataset.
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

from basetree.errors import SettingsError
from perceptree.data import read_dataset
from perceptree.data.layouts import find_splits
from perceptree.errors import DatasetError
from perceptree.models import ModelSpec
from perceptree.settings.training import Engine, TrainSettings
from perceptree.training.counts import Progress, Status
from perceptree.training.run import train
from perceptree.training.source import Preparing
from perceptree.training.starting import Init
from perceptree.training.state import STATE_NAME, read_state
from perceptree.training.trainer import TrainReport

_SETTINGS_FILE = "settings.json"
_GROWTH_FACTOR = 2
_SECONDS_PER_MINUTE = 60.0
_TERMINATION_TIMEOUT_S = 30.0


class _SimulationEnded(KeyboardInterrupt):
    """The simulation has ended. Stops a stage like Ctrl-C, so that its state is saved."""


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
    """Train on a dataset of `perceptree synth` while it is extended to `frames` frames.

    The dataset doubles with every stage. Half of the cores simulate. A call with the same
    arguments resumes an interrupted training and its simulation.

    Args:
        spec: The model.
        settings: The training. `minutes` limits the sum over all stages; the simulation ends
            with it.
        data: Folder of the dataset.
        frames: Final number of frames.
        out: Folder of the stages `stage-1`, `stage-2` and so on.
        progress: Called with the status after every step.
        init: Starting weights; random if None.
        engine: Hardware and speed.
        preparing: Called with the progress of the preparation.

    Returns:
        The report of the last stage.

    Raises:
        SettingsError: If the settings have no time limit, a schedule that depends on the end, or
            several processes; or as `train` does.
        DatasetError: If the folder is no simulated dataset, or the simulation fails.
        CheckpointError: As `train` does.
    """
    engine = engine or Engine()
    preparing = preparing or Preparing()
    _check(settings)
    while True:
        stages = _stages(out)
        spent_s = sum(_elapsed_s(stage) for stage in stages)
        left = (settings.minutes or 0.0) - spent_s / _SECONDS_PER_MINUTE
        if left <= 0:
            raise SettingsError(
                f"minutes is {settings.minutes:g}, which the training in {out} has used up:"
                " expected more to continue it"
            )
        stage = out / f"stage-{len(stages) + 1}"
        goal = min(frames, _GROWTH_FACTOR * _frames_in(data))
        preparing.say(f"{stage.name}: {_frames_in(data)} frames, simulating up to {goal}")
        with _simulating(data, goal) as simulation:
            try:
                return train(
                    spec,
                    dataclasses.replace(settings, minutes=left),
                    data,
                    stage,
                    _stop_when_simulated(simulation, progress, spent_s, settings.minutes or 0.0),
                    None if stages else init,
                    engine,
                    stages[-1] if stages else None,
                    preparing,
                )
            except _SimulationEnded as stop:
                if simulation is not None and simulation.returncode:
                    raise DatasetError(_last_line(simulation)) from stop


def _check(settings: TrainSettings) -> None:
    if settings.minutes is None:
        raise SettingsError(
            "minutes is not given: expected a time limit, as --simulate does not count steps"
        )
    if settings.depends_on_end:
        raise SettingsError(
            f"schedule is {settings.schedule}: expected constant or steps, because the stages of"
            " --simulate have no known end"
        )
    if int(os.environ.get("WORLD_SIZE", "1")) > 1:
        raise SettingsError(
            f"WORLD_SIZE is {os.environ['WORLD_SIZE']}: expected one process, or a training"
            " without --simulate"
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
    return sum(len(read_dataset(data, labels.split).frames) for labels in find_splits(data))


def _stop_when_simulated(
    simulation: subprocess.Popen[str] | None, progress: Progress, spent_s: float, minutes: float
) -> Progress:
    """Report the progress over all stages, and stop the stage when the simulation has ended."""

    def report(status: Status) -> None:
        elapsed_s = spent_s + status.elapsed_s
        done = min(1.0, elapsed_s / (minutes * _SECONDS_PER_MINUTE))
        progress(dataclasses.replace(status, done=done, elapsed_s=elapsed_s))
        if simulation is not None and done < 1 and simulation.poll() is not None:
            raise _SimulationEnded

    return report


def _last_line(simulation: subprocess.Popen[str]) -> str:
    lines = (simulation.communicate()[1] or "").strip().splitlines()
    reason = lines[-1].removeprefix("perceptree: ") if lines else "no error message"
    return f"the simulation failed: {reason}"


@contextmanager
def _simulating(data: Path, frames: int) -> Iterator[subprocess.Popen[str] | None]:
    """Extend `data` to `frames` frames in another process; None if it has as many already."""
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
            simulation.communicate(timeout=_TERMINATION_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            simulation.kill()


def _start_simulating(data: Path, frames: int, workers: int) -> subprocess.Popen[str]:
    path = data / _SETTINGS_FILE
    try:
        record = json.loads(path.read_text("utf-8"))
        seed, image_format = int(record["seed"]), str(record["files"]["image_format"])
    except (OSError, ValueError, LookupError, TypeError, ArithmeticError, RecursionError) as error:
        raise DatasetError(
            f"{path}: not readable as settings, expected a dataset of perceptree synth"
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
