"""The log of a run: ``log.jsonl`` for programs, TensorBoard's event files for eyes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from perceptree.errors import CheckpointError

LOG_NAME = "log.jsonl"
EVENTS_NAME = "tensorboard"


class RunLog:
    """Appends entries of nested numbers to both logs of the folder of a run."""

    def __init__(self, out: Path, first_step: int) -> None:
        from torch.utils.tensorboard import SummaryWriter

        self._path = out / LOG_NAME
        # What a killed run logged after its last saved state is written again.
        self._events = SummaryWriter(str(out / EVENTS_NAME), purge_step=first_step + 1)

    def write(self, entry: dict[str, Any]) -> None:
        """Append an entry; it has a ``step``. Raises CheckpointError where the disk refuses."""
        try:
            with self._path.open("a", encoding="utf-8") as log:
                log.write(json.dumps(entry) + "\n")
            for name, value in _scalars(entry):
                self._events.add_scalar(name, value, entry["step"])
            self._events.flush()
        except OSError as error:
            raise CheckpointError(f"{self._path}: cannot be written ({error.strerror})") from error

    def close(self) -> None:
        """Let the event file go."""
        self._events.close()


def read_log(out: Path) -> list[dict[str, Any]]:
    """The entries of a run in the order of their steps; of a step written twice the last.

    Raises CheckpointError for a folder without a log, or a line that is none of this project.
    """
    path = out / LOG_NAME
    try:
        lines = path.read_text("utf-8").splitlines()
    except OSError as error:
        raise CheckpointError(
            f"{path}: cannot be read ({error.strerror}); expected the folder of a training"
        ) from error
    entries: dict[tuple[int, bool], dict[str, Any]] = {}
    for number, line in enumerate(lines, start=1):
        try:
            entry = json.loads(line)
            entries[int(entry["step"]), "val" in entry] = entry
        except (ValueError, KeyError, TypeError) as error:
            if number == len(lines):
                break  # a killed run may leave half a line
            raise CheckpointError(f"{path}: line {number} is no entry of a training") from error
    return [entries[key] for key in sorted(entries)]


def _scalars(entry: dict[str, Any], prefix: str = "") -> list[tuple[str, float]]:
    """Names joined by slashes, and numbers."""
    found: list[tuple[str, float]] = []
    for name, value in entry.items():
        if isinstance(value, dict):
            found += _scalars(value, f"{prefix}{name}/")
        elif isinstance(value, int | float) and name != "step":
            found.append((f"{prefix}{name}", float(value)))
    return found
