"""Output to the terminal: notes and progress bars on stderr, results on stdout.

All lines of all programs, and what they log, are printed here. They may quote names and texts of
strangers, so that each is cleaned: see `basetree.errors.one_line`.
"""

from __future__ import annotations

import io
import json
import logging
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Protocol, TextIO, TypeVar, cast

import typer

from basetree.errors import one_line, short_line

_T = TypeVar("_T")


class Progress(Protocol):
    """A progress bar."""

    def update(self, n_steps: int) -> None:
        """Advance the bar by `n_steps`."""


class _NoBar:
    def update(self, n_steps: int) -> None:
        """Do nothing."""


def note(text: str) -> None:
    """Print one line of at most 2000 characters on stderr, if it can be written."""
    with suppress(OSError):
        typer.echo(short_line(text), err=True)


def tell(text: object) -> None:
    """Print one line on stdout."""
    typer.echo(one_line(str(text)))


class LogNotes(logging.Handler):
    """Prints what is logged as notes."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one record."""
        note(record.getMessage())


class _BarStream(io.TextIOBase):
    """The stderr of this moment, for progress bars, which end with its terminal and not before."""

    def write(self, text: str) -> int:
        with suppress(OSError):
            sys.stderr.write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            sys.stderr.flush()

    def isatty(self) -> bool:
        return sys.stderr.isatty()

    def fileno(self) -> int:
        return sys.stderr.fileno()


BAR_STREAM = cast("TextIO", _BarStream())
"""Where progress bars go."""


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
        tell(line)


@contextmanager
def progress(label: str, steps: int, *, shown: bool = True) -> Iterator[Progress]:
    """Show a progress bar of `steps` steps with the estimated time left.

    Nothing is shown if stderr is not a terminal or `shown` is false.
    """
    if not (shown and sys.stderr.isatty()):
        yield _NoBar()
        return
    with typer.progressbar(length=steps, label=label, file=BAR_STREAM) as bar:
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
            bar = typer.progressbar(length=total, label=label, file=BAR_STREAM).__enter__()
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
    with typer.progressbar(items, length=count, label=label, file=BAR_STREAM) as bar:
        yield from bar
