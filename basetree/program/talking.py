"""How much a program says: the options --quiet, --verbose and --log-file of all commands."""

from __future__ import annotations

import inspect
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from basetree.errors import InputError
from basetree.program.console import TALK, LogNotes, note
from basetree.program.options import expand_groups

GENERAL = "General"
"""The last group of options in the help, which most commands have."""


@dataclass(frozen=True)
class TalkOptions:
    """How much a command says, and where."""

    panel = GENERAL

    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print results and errors only.")] = (
        False
    )
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose",
            "-v",
            help="Print also versions, what libraries log, the time taken, and where errors arose.",
        ),
    ] = False
    log_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File for all messages with their times, also with --quiet. An older one is kept"
            " beside it.",
        ),
    ] = None

    def apply(self) -> None:
        """Let the process talk so until it ends; may be called for a program and its command.

        Raises:
            InputError: --quiet and --verbose are both given, or two log files.
            UnwritableFile: The log cannot be written.
        """
        if (self.quiet or TALK.quiet) and (self.verbose or TALK.verbose):
            raise InputError("--verbose given with --quiet: expected one of them")
        if self.log_file is not None and TALK.log is not None:
            raise InputError("--log-file given twice: expected one")
        TALK.quiet |= self.quiet
        TALK.verbose |= self.verbose
        if self.log_file is not None:
            TALK.log = _Log(self.log_file)
        if self.verbose or self.log_file is not None:
            logging.lastResort = LogNotes(logging.INFO)
            logging.root.setLevel(logging.INFO)
            _say_versions()


def with_talk_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of `TalkOptions`."""
    hints = get_type_hints(command, include_extras=True)

    @wraps(command)
    def talking(talk: TalkOptions, **values: Any) -> Any:
        talk.apply()
        return command(**values)

    given = inspect.signature(command).parameters.values()
    talk = inspect.Parameter("talk", inspect.Parameter.KEYWORD_ONLY, annotation=TalkOptions)
    talking.__dict__["__signature__"] = inspect.Signature([*given, talk])
    talking.__annotations__ = hints | {"talk": TalkOptions}
    return expand_groups(talking)


def end_talk() -> None:
    """Talk as at first."""
    if isinstance(TALK.log, _Log):
        TALK.log.close()
    TALK.quiet = TALK.verbose = False
    TALK.log = None
    logging.root.setLevel(logging.WARNING)


class _Log:
    """Writes lines with their times into a file; a log that fails is told once, and ends."""

    def __init__(self, path: Path) -> None:
        from basetree.files.growing import GrowingFile

        self._file: GrowingFile | None = GrowingFile(path)

    def __call__(self, line: str) -> None:
        if self._file is None:
            return
        try:
            self._file.write(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {line}\n")
            self._file.flush()
        except OSError as error:
            self._file = None
            note(f"--log-file: {error.filename}: {error.strerror}: the log ends here")

    def close(self) -> None:
        """Write the rest to the disk."""
        file, self._file = self._file, None
        if file is not None:
            try:
                file.close()
            except OSError as error:
                note(f"--log-file: {error.filename}: {error.strerror}")


def _say_versions() -> None:
    """Say what runs."""
    import platform

    from basetree.program.python import installed_version

    named = [
        f"{name} {version}"
        for name in ("edgetree", "numpy", "onnxruntime", "torch")
        if (version := installed_version(name)) is not None
    ]
    text = f"{', '.join(named)}, Python {platform.python_version()}, {platform.platform()}"
    if TALK.verbose:
        note(text)
    elif TALK.log is not None:
        TALK.log(text)
