"""Messages and the progress of a training on stderr."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from basetree.program.console import StatusLine, note
from basetree.program.progress import duration

if TYPE_CHECKING:
    from perceptree.training import Status


def say(line: str) -> None:
    """Print a message for the user to stderr, if it can be written."""
    note(f"perceptree: {line}")


class TrainingBar:
    """Shows the status of a training, as `StatusLine` does."""

    def __init__(self, shown: bool) -> None:
        self._line = StatusLine(shown)

    def __call__(self, status: Status) -> None:
        """Show the status if it is due."""
        self._line.show(partial(_line, status), last=status.done >= 1)


def _line(status: Status) -> str:
    left_s = status.elapsed_s * (1 - status.done) / max(status.done, 1e-6)
    total = sum(status.losses.values())
    losses = " ".join(f"{name} {value:.3f}" for name, value in status.losses.items())
    ap = "" if status.box_ap is None else f", val AP {status.box_ap:.1f}"
    return (
        f"{status.done:4.0%} step {status.step}, {status.frames_per_s:.1f} frames/s,"
        f" {duration(left_s)} left{ap}, loss {total:.3f} ({losses})"
    )
