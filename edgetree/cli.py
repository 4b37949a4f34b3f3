"""The command line `edgetree`."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from importlib.metadata import version
from typing import Annotated

import typer

import calib
from calib.errors import short_line
from edgetree.commands.bench import bench
from edgetree.commands.calibrate import calibrate
from edgetree.commands.check import check
from edgetree.commands.demo import demo
from edgetree.commands.doctor import doctor
from edgetree.commands.eval import evaluate
from edgetree.commands.export import export
from edgetree.commands.measure import measure
from edgetree.commands.run import run
from edgetree.commands.verify import verify
from edgetree.console import note

__all__ = ["app", "main"]

app = typer.Typer(
    name="edgetree",
    help="Find trees in camera frames and measure them in metres.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help appears three times as fast
)
app.command()(demo)
app.command()(run)
app.command()(measure)
app.command()(check)
app.command()(calibrate)
app.command(name="eval")(evaluate)
app.command()(bench)
app.command()(export)
app.command()(verify)
app.command()(doctor)

_INTERRUPTED = 130  # exit code: 128 + SIGINT


def _print_version(requested: bool) -> None:
    if requested:
        typer.echo(f"edgetree {version('edgetree')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def options(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
    max_megapixels: Annotated[
        int | None,
        typer.Option(
            min=1, help="Largest pictures that are read, in millions of pixels.", show_default="200"
        ),
    ] = None,
) -> None:
    """Print the help if no command is given."""
    if max_megapixels is not None:
        limit = max_megapixels * 1_000_000
        calib.set_limits(replace(calib.current_limits(), image_pixels=limit))
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main() -> None:
    """Run the command line and exit.

    Exit codes: 0 success, 1 a check failed, 2 wrong usage or bad input, 130 interrupted.

    An error with an attribute `exit_code` is meant for the user and is printed as one line on
    stderr. Any other error is a bug and shows its traceback.
    """
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    try:
        code = typer.main.get_command(app).main(prog_name="edgetree", standalone_mode=False) or 0
    except (KeyboardInterrupt, typer.Abort):
        code = _INTERRUPTED
    except Exception as error:
        code = getattr(error, "exit_code", None)
        if code is None:
            raise
        note(f"edgetree: {_one_line(error)}")
    if code == _INTERRUPTED:
        note("edgetree: interrupted")
    sys.exit(code)


def _one_line(error: Exception) -> str:
    """The error's message on one line; usage errors of typer also name the command's help."""
    message = error.format_message() if hasattr(error, "format_message") else str(error)
    context = getattr(error, "ctx", None)
    hint = f" (see `{context.command_path} --help`)" if context is not None else ""
    return short_line(" ".join(message.split())) + hint
