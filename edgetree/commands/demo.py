"""`edgetree demo`: run everything on frames with ground truth and write a report."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from basetree.counts import counted
from basetree.program.console import StatusLine, note, print_json, tell
from basetree.program.progress import duration
from basetree.program.quoting import quoted
from edgetree.commands.options import Json

_DONE: Final = "done"

if TYPE_CHECKING:
    from edgetree.demo import DemoResult, NextCommand, Progress


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the report; made if needed.")] = Path(
        "edgetree-demo"
    ),
    train: Annotated[
        bool,
        typer.Option(
            "--train",
            help="Simulate, train, evaluate and export a small model, then run it. Needs the"
            " extras cpu, train, export and sim, and up to 15 minutes.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Measure sample frames, compare with the truth, measure the speed and write a report.

    Prints the path of the report, a self-contained HTML file.
    """
    from basetree.files.writing import output_folder
    from edgetree.demo import run_embedded, write_report
    from edgetree.demo.training import run_trained

    if train:
        _check_no_signature_required()
    with output_folder(out):
        with _progress() as on_progress:
            result = run_trained(out, on_progress) if train else run_embedded(on_progress)
        report = write_report(out, result, _next_commands(out, train))
    for line in _summary(result):
        note(line)
    if as_json:
        print_json(result.to_dict(str(report)))
    else:
        note("report:")
        tell(report)


def _check_no_signature_required() -> None:
    """Raise SignatureError if the model of --train could not be opened after the training."""
    from edgetree.errors import SignatureError
    from edgetree.signing.verify import is_signature_required

    if is_signature_required():
        raise SignatureError(
            "--train makes a model without a signature, which is required here: expected a machine"
            " or an account without this setting (see `edgetree trust`)"
        )


@contextmanager
def _progress() -> Iterator[Progress]:
    """Shows share and time left; without a terminal, also a line for each step."""
    said, start_s, line = "", time.monotonic(), StatusLine()

    def tell(share: float, what: str) -> None:
        nonlocal said
        if what != said and what != _DONE and not sys.stderr.isatty():
            note(f"{share:4.0%}  {what}")
        said = what
        taken_s = time.monotonic() - start_s
        left = f", {duration(taken_s * (1 - share) / share)} left" if share > 0 else ""
        line.show(lambda: f"{share:4.0%}  {what}{left}", last=what == _DONE)

    yield tell
    tell(1.0, _DONE)


def _summary(result: DemoResult) -> Iterator[str]:
    """One line per model."""
    for model in result.models:
        error_m = model.summary("diameter_m").median_abs_error_m
        metres = "no diameter"
        if error_m is not None:
            metres = f"diameters from the depth images within {error_m * 100:.1f} cm"
        yield (
            f"{model.manifest.modality:5}  {model.found_trees} of"
            f" {counted(model.true_trees, 'tree')} found,"
            f" {metres} (median), {model.fps:.0f} frames per second"
        )


def _next_commands(out: Path, train: bool) -> list[NextCommand]:
    """Suggestions for the last section of the report."""
    from basetree.errors import install_hint
    from edgetree.demo import NextCommand

    model = f" --model {quoted(out / 'model.onnx')}" if train else ""
    measured = quoted(out / "model.onnx") if train else "depth"
    commands = [
        NextCommand(
            "Measure trees in your own frames and write a report, with a 16-bit depth image in"
            " millimetres for each frame and the camera's calibration:",
            f"edgetree run FRAMES --depth DEPTHS --camera camera.json --report trees.html{model}",
        ),
        NextCommand("Measure the speed on this machine:", f"edgetree bench {measured}"),
    ]
    if not train:
        commands[:0] = [
            NextCommand(
                "Detect and draw the trees in your own picture, folder or video:",
                "edgetree run PICTURE --out pictures",
            )
        ]
        commands.append(
            NextCommand(
                "Simulate, train, export and run your own model (first"
                f" {install_hint('cpu', 'train', 'export', 'sim')}):",
                "edgetree demo --train",
            )
        )
    return commands
