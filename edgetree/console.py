"""What a person at the terminal sees beside a command's output: notes and progress, on stderr."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol, TypeVar

import typer

__all__ = ["note", "print_json", "progress", "track"]

_T = TypeVar("_T")


class Progress(Protocol):
    """A bar that moves by steps."""

    def update(self, n_steps: int) -> None:
        """Move on by `n_steps`."""


class _NoBar:
    def update(self, n_steps: int) -> None:
        """Show nothing."""


def note(text: str) -> None:
    """One line on stderr."""
    typer.echo(text, err=True)


def print_json(value: dict[str, Any]) -> None:
    """One JSON object on stdout."""
    typer.echo(json.dumps(value, allow_nan=False))


@contextmanager
def progress(label: str, steps: int, *, shown: bool = True) -> Iterator[Progress]:
    """A bar of `steps` steps with an estimate of the time left, where stderr is a terminal."""
    if not (shown and sys.stderr.isatty()):
        yield _NoBar()
        return
    with typer.progressbar(length=steps, label=label, file=sys.stderr) as bar:
        yield bar


def track(
    items: Iterable[_T], label: str, count: int | None = None, *, shown: bool = True
) -> Iterator[_T]:
    """The items, with such a bar; without a `count` the bar says only that it moves."""
    if not (shown and sys.stderr.isatty()):
        yield from items
        return
    with typer.progressbar(items, length=count, label=label, file=sys.stderr) as bar:
        yield from bar
