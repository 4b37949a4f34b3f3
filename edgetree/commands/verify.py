"""`edgetree verify`: check that a model file finds the same trees as its checkpoint."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from basetree.program.console import note, print_json, tell, tell_words
from basetree.program.progress import steps_shown
from basetree.program.quoting import quoted
from edgetree.commands.export import check_inputs, record, showing_differences
from edgetree.commands.options import Json


def verify(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A model file of `edgetree export`.")
    ],
    checkpoint: Annotated[
        Path, typer.Argument(metavar="CKPT", help="The checkpoint that it was exported from.")
    ],
    data: Annotated[
        Path,
        typer.Option(help="Folder of real frames, or a dataset or its label file, to compare on."),
    ],
    as_json: Json = False,
) -> None:
    """Repeat the parity check of an export, on any frames and on this machine."""
    check_inputs(checkpoint, data)
    from edgetree.export import verify_model

    with showing_differences(), steps_shown("reading file and checkpoint") as say:
        report = verify_model(file, checkpoint, data=data, say=say)
    if as_json:
        print_json(record(report))
        return
    for line in report.parity.table().splitlines():
        tell_words(line)
    tell(f"{file} finds the same trees as {checkpoint} ({report.manifest.precision})")
    note(f"next: edgetree bench {quoted(file)}", whole=True)
