"""The ``perceptree`` command line."""

from __future__ import annotations

import sys
from importlib.metadata import version
from typing import Annotated

import typer

from calib.errors import short_line
from perceptree.commands.data import app as data
from perceptree.commands.eval import evaluate
from perceptree.commands.import_ import import_
from perceptree.commands.plot import plot
from perceptree.commands.predict import predict
from perceptree.commands.scene import scene
from perceptree.commands.synth import synth
from perceptree.commands.tables import tables
from perceptree.commands.train import train

app = typer.Typer(
    name="perceptree",
    help="Simulate forests, train tree detectors and evaluate them.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command()(synth)
app.command()(scene)
app.command()(train)
app.command(name="eval")(evaluate)
app.command()(tables)
app.command()(plot)
app.command()(predict)
app.command(name="import")(import_)
app.add_typer(data, name="data")

_INTERRUPTED = 130


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"perceptree {version('edgetree')}")
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
) -> None:
    """Print the help if no command is given."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main() -> None:
    """Run the command line and exit.

    Exit codes: 0 success, 1 a check failed, 2 wrong usage or bad input, 130 interrupted. An error
    with an ``exit_code`` is printed as one line on stderr; any other error is raised.
    """
    try:
        code = typer.main.get_command(app).main(prog_name="perceptree", standalone_mode=False) or 0
    except (KeyboardInterrupt, typer.Abort):
        code = _INTERRUPTED
    except ModuleNotFoundError as error:
        typer.echo(f'perceptree: {error}: install with pip install ".[train,sim]"', err=True)
        code = 2
    except Exception as error:
        code = getattr(error, "exit_code", None)
        if code is None:
            raise
        typer.echo(f"perceptree: {_one_line(error)}", err=True)
    if code == _INTERRUPTED:  # typer returns this code for Ctrl-C inside a command
        typer.echo("perceptree: interrupted; run the same command again to resume", err=True)
    sys.exit(code)


def _one_line(error: Exception) -> str:
    """Return the message as one line, with a hint for typer's usage errors."""
    message = error.format_message() if hasattr(error, "format_message") else str(error)
    context = getattr(error, "ctx", None)
    hint = f" (see `{context.command_path} --help`)" if context is not None else ""
    return short_line(" ".join(message.split())) + hint
