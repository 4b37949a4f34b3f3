"""`edgetree check-rig`: whether calibration and alignment still hold, from a minute of driving."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from basetree.program.console import print_found
from basetree.program.options import expand_groups
from edgetree.commands.live_options import LiveRigOptions, LiveSourceOptions
from edgetree.commands.option_groups import SessionOptions
from edgetree.commands.options import Json, Model


@expand_groups
def check_rig(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A recording, a camera with depth, a simulated drive or a folder of images with"
            " --depth, as for `edgetree live`.",
        ),
    ],
    *,
    seconds: Annotated[
        float, typer.Option(metavar="S", help="How much of the source is read, seconds.")
    ] = 60.0,
    model: Model = "depth",
    cameras: LiveRigOptions,
    source_options: LiveSourceOptions,
    session: SessionOptions,
    as_json: Json = False,
) -> None:
    """Check from a minute of driving whether the cameras' calibration still holds.

    Compares jumps in depth with edges in colour, the given vertical with the stems, and the scale
    of depth with the machine's motion. Each check holds, does not hold, or cannot tell.

    Stereo pairs (--right) are refused: their depth comes from the colour itself.

    The exit code is 1 if a check does not hold.
    """
    from basetree.errors import CheckFailed, InputError
    from edgetree.commands.frame_results import warnings_shown
    from edgetree.rig_check import check_rig as checked
    from edgetree.rig_check.report import problem_text, report_lines

    if not (math.isfinite(seconds) and seconds > 0):
        raise InputError(f"--seconds is {seconds}: expected seconds above 0")
    if source_options.right_given is not None:
        raise InputError(
            f"{source_options.right_given} given: expected a camera with depth of its own, as the"
            " depth of a stereo pair comes from its colour"
        )
    rig = cameras.as_rig_options().rig(cameras.camera, None)
    detector, _ = session.open_model(model)
    with warnings_shown():
        report = checked(source_options.open(source, rig, False), detector, rig, seconds)
    record = {"schema": "edgetree.check-rig/1", **report.to_dict()}
    print_found(as_json, lambda: record, lambda: report_lines(report))
    if not report.passed:
        problems = "; ".join(problem_text(check) for check in report.problems)
        raise CheckFailed(f"{report.source}: the check failed: {problems}")
