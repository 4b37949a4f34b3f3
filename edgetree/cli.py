"""The command line `edgetree`."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Annotated, NoReturn

import typer

from basetree.program.command_line import Version, run_app, show_help
from basetree.program.help import new_app
from basetree.program.options import expand_groups
from basetree.program.talking import TalkOptions
from edgetree.commands.bench import bench
from edgetree.commands.calibrate import calibrate
from edgetree.commands.check import check
from edgetree.commands.check_rig import check_rig
from edgetree.commands.combine import combine
from edgetree.commands.compare import compare
from edgetree.commands.config import config
from edgetree.commands.conformance import conformance
from edgetree.commands.demo import demo
from edgetree.commands.doctor import doctor
from edgetree.commands.eval import evaluate
from edgetree.commands.export import export
from edgetree.commands.live import live
from edgetree.commands.measure import measure
from edgetree.commands.merge import merge
from edgetree.commands.models import models
from edgetree.commands.run import run
from edgetree.commands.samples import samples
from edgetree.commands.schema import schema
from edgetree.commands.sign import sign
from edgetree.commands.trust import trust
from edgetree.commands.verify import verify

app = new_app("Find trees in camera frames and measure them in metres.", "edgetree")
_START, _TREES, _MACHINE, _MODELS = "First steps", "Trees", "Cameras and machines", "Models"
_RIG = "--depth samples/depth --camera samples/camera.json"

app.add(demo, "edgetree demo --out edgetree-demo", group=_START)
app.add(samples, "edgetree samples --out samples", group=_START)
app.add(doctor, "edgetree doctor", group=_START)
app.add(run, f"edgetree run samples/pictures {_RIG} --csv trees.csv", group=_TREES)
app.add(
    measure,
    "edgetree measure samples/pictures/sample_0.jpg --depth samples/depth/sample_0.png"
    " --camera samples/camera.json",
    group=_TREES,
)
app.add(live, "edgetree live samples/drive --map stems.geojson", group=_TREES)
app.add_typer(config, name="config", rich_help_panel=_MACHINE)
app.add(merge, "edgetree merge s3://forest/shards --csv trees.csv", group=_TREES)
app.add(calibrate, "edgetree calibrate photos --board checkerboard:9x6:0.025", group=_MACHINE)
app.add(check_rig, "edgetree check-rig samples/drive --seconds 20", group=_MACHINE)
app.add(check, "edgetree check trees.csv samples/caliper.csv", group=_MACHINE)
app.add(trust, "edgetree trust forest.pub --require", group=_MACHINE)
app.add(models, "edgetree models", group=_MODELS)
app.add(evaluate, "edgetree eval edge-n-rgb trees --out evaluation", group=_MODELS, name="eval")
app.add(bench, "edgetree bench edge-n-rgb edge-n-depth --out bench.json", group=_MODELS)
app.add(compare, "edgetree compare before.json after.json", group=_MODELS)
app.add(
    export, "edgetree export run/best.safetensors --data trees --out forest.onnx", group=_MODELS
)
app.add(
    combine,
    "edgetree combine models/edge-s.onnx --colour edge-s-rgb --depth edge-s-depth --out all.onnx",
    group=_MODELS,
)
app.add(verify, "edgetree verify forest.onnx run/best.safetensors --data trees", group=_MODELS)
app.add(sign, "edgetree sign forest.onnx --key forest.key", group=_MODELS)
app.add(schema, "edgetree schema edgetree.frame/1", group=_MODELS)
app.add_typer(conformance, name="conformance", rich_help_panel=_MODELS)


@app.callback(invoke_without_command=True)
@expand_groups
def options(
    context: typer.Context,
    *,
    version: Version = False,
    max_megapixels: Annotated[
        int | None,
        typer.Option(
            min=1, help="Largest pictures that are read, in millions of pixels.", show_default="200"
        ),
    ] = None,
    require_signature: Annotated[
        bool,
        typer.Option(
            "--require-signature",
            help="Open only models that are signed with a trusted key, as if the machine required"
            " it (see `edgetree trust`).",
        ),
    ] = False,
    talk: TalkOptions,
) -> None:
    """Print the help if no command is given."""
    talk.apply()
    if max_megapixels is not None:
        from basetree.files import current_limits, set_limits

        limit = max_megapixels * 1_000_000
        before = set_limits(replace(current_limits(), image_pixels=limit))
        context.call_on_close(lambda: set_limits(before))
    if require_signature:
        from edgetree.signing import require_signatures

        require_signatures()
    show_help(context)


def main() -> NoReturn:
    """Run the command line and exit, as `run_app` says."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    run_app(app, "edgetree")
