"""The command line `edgetree`."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Annotated, NoReturn

import typer

from basetree.program.command_line import Version, new_app, run_app, show_help
from edgetree.commands.bench import bench
from edgetree.commands.calibrate import calibrate
from edgetree.commands.check import check
from edgetree.commands.check_rig import check_rig
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
app.command()(demo)
app.command()(samples)
app.command()(run)
app.command()(measure)
app.command()(merge)
app.command()(live)
app.add_typer(config)
app.command()(check)
app.command()(check_rig)
app.command()(calibrate)
app.command(name="eval")(evaluate)
app.command()(models)
app.command()(bench)
app.command()(compare)
app.command()(export)
app.command()(verify)
app.add_typer(conformance)
app.command()(schema)
app.command()(sign)
app.command()(trust)
app.command()(doctor)


@app.callback(invoke_without_command=True)
def options(
    context: typer.Context,
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
) -> None:
    """Print the help if no command is given."""
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
