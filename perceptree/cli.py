"""The ``perceptree`` command line."""

from __future__ import annotations

from importlib.metadata import version
from typing import Annotated, NoReturn

import typer

from basetree.errors import MissingPackage
from basetree.program.process import run_command_line
from perceptree.commands.average import average
from perceptree.commands.calibrate_scores import calibrate_scores
from perceptree.commands.data import app as data
from perceptree.commands.eval import evaluate
from perceptree.commands.import_ import import_
from perceptree.commands.merge import merge
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
app.command()(merge)
app.command()(train)
app.command(name="eval")(evaluate)
app.command()(average)
app.command(name="calibrate-scores")(calibrate_scores)
app.command()(tables)
app.command()(plot)
app.command()(predict)
app.command(name="import")(import_)
app.add_typer(data, name="data")


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


def main() -> NoReturn:
    """Run the command line and exit.

    Exit codes: 0 success, 1 a check failed, 2 wrong usage or bad input, 130 interrupted, 143 ended
    by SIGTERM.
    """
    run_command_line("perceptree", _run, "; run the same command again to resume")


def _run() -> object:
    try:
        return typer.main.get_command(app).main(prog_name="perceptree", standalone_mode=False)
    except ModuleNotFoundError as error:
        raise MissingPackage(f'{error}: install with pip install ".[train,sim]"') from error
