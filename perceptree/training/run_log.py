"""The log of a training run: `log.jsonl` and TensorBoard's event files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from basetree.files.regular import read_regular
from perceptree.errors import CheckpointError

LOG_NAME = "log.jsonl"
EVENTS_NAME = "tensorboard"
_MOST_STEPS = 10**12


class RunLog:
    """Appends entries of nested numbers to both logs of a run.

    What a killed run has left of its last line is cut off.

    Args:
        out: Folder of the run.
        first_step: Step at which the run starts or resumes.
    """

    def __init__(self, out: Path, first_step: int) -> None:
        from torch.utils.tensorboard import SummaryWriter

        self._path = out / LOG_NAME
        _end_last_line(self._path)
        # A resumed run logs the steps after its last saved state again.
        self._events = SummaryWriter(str(out / EVENTS_NAME), purge_step=first_step + 1)

    def write(self, entry: dict[str, Any]) -> None:
        """Append an entry.

        Args:
            entry: Numbers by name, possibly nested, with a `step`.

        Raises:
            CheckpointError: If the log cannot be written.
        """
        try:
            with self._path.open("a", encoding="utf-8") as log:
                log.write(json.dumps(entry) + "\n")
            for name, value in _scalars(entry):
                self._events.add_scalar(name, value, entry["step"])
            self._events.flush()
        except OSError as error:
            raise CheckpointError(f"{self._path}: cannot be written ({error.strerror})") from error

    def close(self) -> None:
        """Close the event file."""
        self._events.close()


def _end_last_line(path: Path) -> None:
    """Cut off a last line that is no whole entry, and end one that is."""
    try:
        with path.open("rb+") as log:
            data = log.read()
            start = data.rfind(b"\n") + 1
            if data[start:].endswith(b"}") and data.count(b"{") == data.count(b"}"):
                log.write(b"\n")
            else:
                log.truncate(start)
    except FileNotFoundError:
        return
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be written ({error.strerror})") from error


def read_log(out: Path) -> list[dict[str, Any]]:
    """Read the log of a run.

    Args:
        out: Folder of the run.

    Returns:
        The entries by ascending step. Of entries written twice, the last one counts.

    Raises:
        CheckpointError: If there is no log, or a line is no log entry.
    """
    path = out / LOG_NAME
    try:
        lines = read_regular(path).decode("utf-8").splitlines()
    except FileNotFoundError as error:
        raise CheckpointError(f"{path}: no such file, expected the folder of a training") from error
    except OSError as error:
        raise CheckpointError(
            f"{path}: cannot be read ({error.strerror}), expected the folder of a training"
        ) from error
    except UnicodeDecodeError as error:
        raise CheckpointError(f"{path}: not a text file, expected the log of a training") from error
    entries: dict[tuple[int, bool], dict[str, Any]] = {}
    for number, line in enumerate(lines, start=1):
        try:
            entry = json.loads(line)
            entries[_step_of(entry), "val" in entry] = entry
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            if number == len(lines):
                break  # a killed run may leave an incomplete last line
            raise CheckpointError(
                f"{path}: line {number} is no log entry of a training, expected an object with a"
                " step"
            ) from error
    return [entries[key] for key in sorted(entries)]


def _step_of(entry: dict[str, Any]) -> int:
    """The step of an entry; ValueError, KeyError or TypeError for what is none."""
    step = entry["step"]
    if type(step) is not int or not 0 <= step <= _MOST_STEPS:
        raise ValueError(f"step is {step!r:.100}")
    return step


def _scalars(entry: dict[str, Any], prefix: str = "") -> list[tuple[str, float]]:
    """Flatten nested numbers, joining their names by slashes."""
    found: list[tuple[str, float]] = []
    for name, value in entry.items():
        if isinstance(value, dict):
            found += _scalars(value, f"{prefix}{name}/")
        elif isinstance(value, int | float) and name != "step":
            found.append((f"{prefix}{name}", float(value)))
    return found
