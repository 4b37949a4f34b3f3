"""Output to the terminal: notes and the state of a step on stderr, results on stdout.

All lines of all programs, and what they log, are printed here. They may quote names and texts of
strangers, so that each is cleaned: see `basetree.errors.one_line`.
"""

from __future__ import annotations

import io
import json
import logging
import shutil
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from textwrap import wrap
from typing import Any, Final, TextIO, cast

import typer

from basetree.errors import one_line, short_line

_TERMINAL_S: Final = 0.5
_FIRST_LINE_S: Final = 5.0
_LINES_S: Final = 60.0
_ERASE: Final = "\r\x1b[2K"


@dataclass
class Talk:
    """How much a program says, see `basetree.program.talking`.

    Attributes:
        quiet: Whether notes and the state of steps are left out.
        verbose: Whether what is logged from level INFO on is printed, and tracebacks of errors.
        log: Takes each line that is printed on stderr, or would be; None for no log.
        remarks: What is kept for the end of a command, see `keep_remarks`; None if nothing is.
    """

    quiet: bool = False
    verbose: bool = False
    log: Callable[[str], None] | None = None
    remarks: list[str] | None = None


TALK: Final = Talk()
"""How much this process says."""


def note(text: str, *, whole: bool = False) -> None:
    """Print one line of at most 2000 characters on stderr, if it can be written.

    A quiet program leaves it out. A terminal shows it in several lines, broken between words,
    where it is too narrow.

    Args:
        text: The line.
        whole: Whether it is never broken, such as a command to copy.
    """
    _print(short_line(text), shown=not TALK.quiet, whole=whole)


def complain(text: str, *, whole: bool = False) -> None:
    """Print what went wrong, as `note` does; a quiet program prints it, too."""
    _print(short_line(text), shown=True, whole=whole)


def _print(line: str, *, shown: bool, whole: bool) -> None:
    if TALK.log is not None:
        TALK.log(line)
    if shown:
        with suppress(OSError):
            StatusLine.erase()
            typer.echo(line if whole else _broken(line), err=True)


def _broken(line: str) -> str:
    """The line in lines that a terminal has place for; as it is where there is no terminal."""
    width = shutil.get_terminal_size().columns
    if not sys.stderr.isatty() or len(line) <= width:
        return line
    lines = wrap(
        line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    return "\n".join(lines)


def tell(text: object) -> None:
    """Print one line on stdout."""
    typer.echo(one_line(str(text)))


class LogNotes(logging.Handler):
    """Prints what is logged as notes: warnings, of a verbose program also from level INFO on."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one record."""
        text = record.getMessage()
        if record.levelno >= logging.ERROR:
            complain(text)
        elif TALK.remarks is not None and hasattr(record, "is_remark"):
            TALK.remarks.append(text)
        elif record.levelno >= logging.WARNING or TALK.verbose:
            note(text)
        elif TALK.log is not None:
            TALK.log(short_line(text))


def keep_remarks() -> None:
    """Keep what is logged with `extra={"is_remark": True}`, until `note_remarks` prints it."""
    TALK.remarks = []


def note_remarks() -> None:
    """Print the remarks that were kept, if any, and keep no more."""
    remarks, TALK.remarks = TALK.remarks or [], None
    for text in remarks:
        note(text)


class _BarStream(io.TextIOBase):
    """The stderr of this moment; a step goes on when its terminal is gone."""

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
"""Where the state of steps goes."""


def print_json(value: dict[str, Any], indent: int | None = None) -> None:
    """Print one JSON object on stdout, on one line if no indent is given."""
    typer.echo(json.dumps(value, allow_nan=False, indent=indent))


def print_found(
    as_json: bool, record: Callable[[], dict[str, Any]], lines: Callable[[], Iterable[str]]
) -> None:
    """Print what was found on stdout: as one JSON object, or as lines of text."""
    if as_json:
        print_json(record())
        return
    for line in lines():
        tell(line)


class StatusLine:
    """The state of a step on stderr.

    On a terminal it is one line that is written over, cut to the terminal's width. Without a
    terminal it is a line of its own: the first after 5 s, then one a minute. A quiet program
    shows none.

    Args:
        shown: Whether to show anything.
    """

    _standing: StatusLine | None = None

    def __init__(self, shown: bool = True) -> None:
        self._shown = shown
        self._is_begun = False
        self._next_s = time.monotonic() + (_TERMINAL_S if BAR_STREAM.isatty() else _FIRST_LINE_S)

    def show(self, text: Callable[[], str], *, last: bool = False) -> None:
        """Show the state if it is time for it.

        Args:
            text: Gives one line.
            last: Whether it is the last one, which is shown if an earlier one was.
        """
        now_s = time.monotonic()
        is_due = self._is_begun if last else now_s >= self._next_s
        if TALK.quiet or not self._shown or not is_due:
            return
        self._is_begun = True
        if not BAR_STREAM.isatty():
            self._next_s = now_s + _LINES_S
            _write(short_line(text()) + "\n")
            return
        self._next_s = now_s + _TERMINAL_S
        line = one_line(text())[: shutil.get_terminal_size().columns - 1]
        _write(_ERASE + line + ("\n" if last else ""))
        StatusLine._standing = None if last else self

    @classmethod
    def erase(cls) -> None:
        """Make place for a line of text."""
        standing, cls._standing = cls._standing, None
        if standing is not None:
            _write(_ERASE)


def _write(text: str) -> None:
    BAR_STREAM.write(text)
    BAR_STREAM.flush()
