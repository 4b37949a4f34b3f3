"""The `perceptree` command line."""

from __future__ import annotations

from typing import NoReturn

import typer

from basetree.program.command_line import Version, run_app, show_help
from basetree.program.help import new_app
from basetree.program.options import expand_groups
from basetree.program.talking import TalkOptions
from perceptree.commands.average import average
from perceptree.commands.calibrate_scores import calibrate_scores
from perceptree.commands.data import app as data
from perceptree.commands.eval import evaluate
from perceptree.commands.import_ import import_
from perceptree.commands.merge import merge
from perceptree.commands.plot import plot
from perceptree.commands.predict import predict
from perceptree.commands.scene import scene
from perceptree.commands.schema import schema
from perceptree.commands.synth import synth
from perceptree.commands.tables import tables
from perceptree.commands.train import train

app = new_app("Simulate forests, train tree detectors and evaluate them.", "perceptree")
_DATA, _NETWORKS, _PROGRAMS = "Data", "Networks", "Programs"

app.add(synth, "perceptree synth --out trees --frames 400", group=_DATA)
app.add(scene, "perceptree scene --out scene.glb --seed 7", group=_DATA)
app.add_typer(data, name="data", rich_help_panel=_DATA)
app.add(predict, "perceptree predict run/best.safetensors photos --out labels", group=_DATA)
app.add(merge, "perceptree merge s3://forest/shards --out trees", group=_DATA)
app.add(train, "perceptree train trees --out run --minutes 60", group=_NETWORKS)
app.add(evaluate, "perceptree eval run/best.safetensors trees", group=_NETWORKS, name="eval")
app.add(plot, "perceptree plot run", group=_NETWORKS)
app.add(
    average,
    "perceptree average run-1/best.safetensors run-2/best.safetensors --out mean.safetensors",
    group=_NETWORKS,
)
app.add(
    calibrate_scores,
    "perceptree calibrate-scores run/best.safetensors photos --out calibrated.safetensors",
    group=_NETWORKS,
    name="calibrate-scores",
)
app.add(tables, "perceptree tables trees --table 2 --out tables --minutes 60", group=_NETWORKS)
app.add(import_, "perceptree import model_final.pth", group=_NETWORKS, name="import")
app.add(schema, "perceptree schema perceptree.evaluation", group=_PROGRAMS)


@app.callback(invoke_without_command=True)
@expand_groups
def options(context: typer.Context, *, version: Version = False, talk: TalkOptions) -> None:
    """Print the help if no command is given."""
    talk.apply()
    show_help(context)


def main() -> NoReturn:
    """Run the command line and exit, as `run_app` says."""
    run_app(
        app,
        "perceptree",
        resume="; run the same command again to resume",
        extras="train,sim",
    )
