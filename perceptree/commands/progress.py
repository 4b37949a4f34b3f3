"""Messages and the progress of a training on stderr."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

from basetree.program.console import BAR_STREAM, note

if TYPE_CHECKING:
    from perceptree.training import Status


def say(line: str) -> None:
    """Print a message for the user to stderr, if it can be written."""
    note(f"perceptree: {line}")


class TrainingBar:
    """Shows the status of a training, at most once per second (per minute without a terminal)."""

    def __init__(self, shown: bool) -> None:
        self._shown, self._terminal = shown, sys.stderr.isatty()
        self._next_s = 0.0

    def __call__(self, status: Status) -> None:
        """Show the status if it is due."""
        now_s = time.monotonic()
        if not self._shown or (now_s < self._next_s and status.done < 1):
            return
        self._next_s = now_s + (1.0 if self._terminal else 60.0)
        end = "\r" if self._terminal and status.done < 1 else "\n"
        BAR_STREAM.write(("\x1b[2K" if self._terminal else "") + _line(status) + end)
        BAR_STREAM.flush()


def _line(status: Status) -> str:
    left_s = status.elapsed_s * (1 - status.done) / max(status.done, 1e-6)
    losses = " ".join(f"{name} {value:.3f}" for name, value in status.losses.items())
    ap = "" if status.box_ap is None else f", val AP {status.box_ap:.1f}"
    return (
        f"{status.done:4.0%} step {status.step}, {status.frames_per_s:.1f} frames/s,"
        f" {left_s / 60:.0f} min left, rate {status.rate:.2g}{ap} | {losses}"
    )
