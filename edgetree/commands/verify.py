"""`edgetree verify`: does a file still find what its checkpoint finds?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from edgetree.commands.export import record, showing_differences
from edgetree.commands.options import Json
from edgetree.console import note, print_json

__all__ = ["verify"]


def verify(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A file of `edgetree export`.")],
    checkpoint: Annotated[
        Path, typer.Argument(metavar="CKPT", help="The checkpoint that it was made from.")
    ],
    data: Annotated[
        Path, typer.Option(help="Folder with real frames, or a data set, to compare on.")
    ],
    as_json: Json = False,
) -> None:
    """Repeat an export's proof on any frames and on this machine."""
    from edgetree.export import verify_model

    with showing_differences():
        report = verify_model(file, checkpoint, data=data, say=note)
    if as_json:
        print_json(record(report))
        return
    typer.echo(report.parity.table())
    typer.echo(f"{file} finds what {checkpoint} finds ({report.manifest.precision})")
    note(f"next: edgetree bench --model {file}")
