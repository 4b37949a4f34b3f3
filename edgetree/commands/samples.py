"""`edgetree samples`: write the sample pictures as the files that the commands read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from basetree.program.console import note, tell


def samples(
    out: Annotated[Path, typer.Option(help="New folder for the files.")] = Path("samples"),
) -> None:
    """Write sample pictures, depth, camera, a drive and a caliper's table to try things on."""
    from edgetree.sample_files import commands_for, write_samples

    write_samples(out)
    note("try:")
    for command in commands_for(out):
        note(f"  {command}", whole=True)
    tell(out)
