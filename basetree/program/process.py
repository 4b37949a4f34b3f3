"""The process of a command line: its streams, signals and exit code."""

from __future__ import annotations

import _thread
import io
import logging
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn, TextIO

import typer

from basetree.errors import short_line
from basetree.program.console import TALK, LogNotes, complain, note, note_remarks
from basetree.program.progress import duration
from basetree.program.talking import end_talk

_FAILED = 1
_BAD_INPUT = 2
_INTERRUPTED = 128 + signal.SIGINT
_ENDING = tuple(
    signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)
)  # SIGHUP comes when a connection drops or a terminal is closed; Windows has none
_AGAIN_S, _MOST_DELAYS = 0.05, 200  # until an interrupt during an import comes again


def run_command_line(name: str, run: Callable[[], object], resume: str = "") -> NoReturn:
    r"""Run a command line and exit.

    SIGTERM and SIGHUP end it as Ctrl-C does, by `KeyboardInterrupt`; all wait for an import in
    progress. An error with an attribute `exit_code` is meant for the user, and so are errors of the
    operating system such as a full disk: they are printed as one line on stderr. Any other error is
    a bug and shows its traceback. If the reader of stdout ends, as `head` does, the process ends
    too, without a message. Bytes of file names that are not UTF-8 are printed as `\udcff`.

    Exit codes: what `run` returns; 1 if nobody reads stdout, 2 if stdout is closed or cannot be
    written, 130 for Ctrl-C, 143 for SIGTERM, 129 for SIGHUP.

    Args:
        name: Name of the program, for messages.
        run: The command line; returns the exit code, or None.
        resume: What an interrupted command tells the user to do.
    """
    stdout = _open_streams(name)
    logging.lastResort = LogNotes(logging.WARNING)
    sys.excepthook = _show_bug
    start_s = time.monotonic()
    with _interruptible() as ending_signal:
        try:
            code = run() or 0
        except (KeyboardInterrupt, typer.Abort):
            code = _INTERRUPTED
        except SystemExit as ended:  # by typer, if nobody reads stdout
            code = ended.code
        except Exception as error:  # noqa: BLE001 raised again if it is a bug
            code = _report(name, error)
        if code == _INTERRUPTED:  # typer returns this code for Ctrl-C inside a command
            complain(f"{name}: interrupted{resume}")
            code = 128 + (ending_signal() or signal.SIGINT)
        fault = _fault(stdout)
        if fault is not None and code == 0:
            code = _FAILED if isinstance(fault, BrokenPipeError) else _report(name, fault)
        note_remarks()
        if TALK.verbose:
            note(f"{name}: exit code {code} after {duration(time.monotonic() - start_s)}")
        end_talk()
        for stream in (stdout, sys.stderr):
            _discard_rest(stream)
        sys.exit(code)  # type: ignore[arg-type]


def _open_streams(name: str) -> TextIO:
    """Check stdout, give a closed stderr a place to go, and accept all names; returns stdout."""
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if sys.stdout is None:
        complain(f"{name}: standard output is closed: expected a terminal, a file or {os.devnull}")
        sys.exit(_BAD_INPUT)
    is_own = sys.stdout is sys.__stdout__  # else another program captures the output
    if is_own:
        sys.stdout = _named(sys.stdout)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    return sys.stdout


def _named(stdout: TextIO) -> TextIO:
    """A stream to the same place, whose errors name it."""
    is_unbuffered = isinstance(stdout.buffer, io.FileIO)  # by PYTHONUNBUFFERED
    raw = stdout.buffer if is_unbuffered else getattr(stdout.buffer, "raw", None)
    if not isinstance(raw, io.FileIO):  # a terminal of Windows
        return stdout
    named = _StandardOutput(stdout.fileno(), "wb", closefd=False)
    return io.TextIOWrapper(
        named if is_unbuffered else io.BufferedWriter(named),
        stdout.encoding,
        line_buffering=bool(stdout.line_buffering),
        write_through=is_unbuffered,
    )


class _StandardOutput(io.FileIO):
    """The process's stdout, whose errors name it."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            raise OSError(error.errno, error.strerror, "standard output") from error


@contextmanager
def _interruptible() -> Iterator[Callable[[], int | None]]:
    """Raise KeyboardInterrupt for Ctrl-C, SIGTERM and SIGHUP in the block.

    Yields a function that returns the last of `_ENDING` that came; None if none did.

    Libraries turn a KeyboardInterrupt during their import into other errors, or let Python end
    itself by SIGINT in the end. An interrupt therefore comes again until no import is in progress,
    for some seconds. It also comes again if Python drops it, as it does with every error in a
    destructor or a callback.
    """
    ending: int | None = None
    delays = 0

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal ending, delays
        ending = number if number in _ENDING else ending
        if delays >= _MOST_DELAYS or not _is_importing(frame):
            raise KeyboardInterrupt
        delays += 1
        send_again(number)

    def send_again(number: int) -> None:
        again = threading.Timer(_AGAIN_S, _send_again, (number,))
        again.daemon = True
        again.start()

    def dropped(error: sys.UnraisableHookArgs) -> None:
        if issubclass(error.exc_type, KeyboardInterrupt):
            send_again(ending or signal.SIGINT)
        else:
            usual_hook(error)

    usual_hook = sys.unraisablehook
    replaced = {}
    if threading.current_thread() is threading.main_thread():
        usual: dict[signal.Signals, Any] = {signal.SIGINT: signal.default_int_handler}
        usual |= dict.fromkeys(_ENDING, signal.SIG_DFL)
        replaced = {
            number: handler
            for number, handler in usual.items()
            if signal.getsignal(number) == handler
        }
    for number in replaced:
        signal.signal(number, interrupt)
    if replaced:
        sys.unraisablehook = dropped
    try:
        yield lambda: ending
    finally:
        sys.unraisablehook = usual_hook
        for number, handler in replaced.items():
            signal.signal(number, handler)


def _send_again(number: int) -> None:
    """Send a signal to the main thread, also while it waits."""
    if sys.platform == "win32":
        _thread.interrupt_main(number)
    else:
        signal.pthread_kill(threading.main_thread().ident or 0, number)


def _is_importing(frame: FrameType | None) -> bool:
    """Whether a module is being imported in the frame or in one of its callers."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _report(name: str, error: Exception) -> int:
    """Print an error that is meant for the user and return its exit code; raise others."""
    code: int | None = getattr(error, "exit_code", None)
    if code is not None:
        complain(f"{name}: {_one_line(error)}")
        if TALK.verbose:
            _show_bug(type(error), error, error.__traceback__)
        return code
    if not isinstance(error, OSError) or error.errno is None:
        raise error
    complain(f"{name}: {error.filename or 'output'}: {error.strerror}")
    return _BAD_INPUT


def _one_line(error: Exception) -> str:
    """The error's message on one line; usage errors of typer also name the command's help."""
    message = error.format_message() if hasattr(error, "format_message") else str(error)
    context = getattr(error, "ctx", None)
    hint = f" (see `{context.command_path} --help`)" if context is not None else ""
    return short_line(" ".join(message.split())) + hint


def _show_bug(*raised: Any) -> None:
    """Print the traceback of an error."""
    for line in "".join(traceback.format_exception(*raised)).splitlines():
        complain(line, whole=True)


def _fault(stream: TextIO) -> OSError | None:
    """Why what was printed cannot be written; None if it was written."""
    try:
        stream.flush()
    except OSError as error:
        return error
    return None


def _discard_rest(stream: TextIO) -> None:
    """Keep Python from writing the rest of a broken stream, and failing, as it exits."""
    if _fault(stream) is not None:
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
