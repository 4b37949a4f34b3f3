"""Output to the terminal: notes and progress bars on stderr, JSON on stdout."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Protocol, TypeVar

import typer

_T = TypeVar("_T")


class Progress(Protocol):
    """A progress bar."""

    def update(self, n_steps: int) -> None:
        """Advance the bar by `n_steps`."""


class _NoBar:
    def update(self, n_steps: int) -> None:
        """Do nothing."""


def note(text: str) -> None:
    """Print one line on stderr, if it can be written."""
    with suppress(OSError):
        typer.echo(text, err=True)


def print_json(value: dict[str, Any]) -> None:
    """Print one JSON object on stdout."""
    typer.echo(json.dumps(value, allow_nan=False))


@contextmanager
def progress(label: str, steps: int, *, shown: bool = True) -> Iterator[Progress]:
    """Show a progress bar of `steps` steps with the estimated time left.

    Nothing is shown if stderr is not a terminal or `shown` is false.
    """
    if not (shown and sys.stderr.isatty()):
        yield _NoBar()
        return
    with typer.progressbar(length=steps, label=label, file=sys.stderr) as bar:
        yield bar


def track(
    items: Iterable[_T], label: str, count: int | None = None, *, shown: bool = True
) -> Iterator[_T]:
    """Yield the items and show a progress bar, as `progress` does.

    Without `count`, the bar only shows that work is going on.
    """
    if not (shown and sys.stderr.isatty()):
        yield from items
        return
    with typer.progressbar(items, length=count, label=label, file=sys.stderr) as bar:
        yield from bar
