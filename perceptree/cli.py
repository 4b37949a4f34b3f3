"""The `perceptree` command line."""

from __future__ import annotations

from typing import NoReturn

import typer

from basetree.program.command_line import Version, new_app, run_app, show_help
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

app = new_app("Simulate forests, train tree detectors and evaluate them.", "perceptree")
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


@app.callback(invoke_without_command=True)
def options(context: typer.Context, version: Version = False) -> None:
    """Print the help if no command is given."""
    show_help(context)


def main() -> NoReturn:
    """Run the command line and exit, as `run_app` says."""
    run_app(
        app,
        "perceptree",
        resume="; run the same command again to resume",
        extras="train,sim",
    )
