"""Output to the terminal: notes and progress bars on stderr, JSON on stdout."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Iterator
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


def print_found(
    as_json: bool, record: Callable[[], dict[str, Any]], lines: Callable[[], Iterable[str]]
) -> None:
    """Print what was found on stdout: as one JSON object, or as lines of text."""
    if as_json:
        print_json(record())
        return
    for line in lines():
        typer.echo(line)


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


def counter(label: str, *, shown: bool = True) -> Callable[[int, int], None]:
    """A function (done, total) that shows a progress bar from its first call to its last.

    Nothing is shown if stderr is not a terminal or `shown` is false. When all is done, the next
    call starts another bar.
    """
    bar: Any = None

    def tell(done: int, total: int) -> None:
        nonlocal bar
        if not (shown and sys.stderr.isatty()):
            return
        if bar is None:
            bar = typer.progressbar(length=total, label=label, file=sys.stderr).__enter__()
        bar.update(done - bar.pos)
        if done == total:
            bar.render_finish()
            bar = None

    return tell


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
