"""`perceptree plot`: plot one or several trainings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from basetree.errors import SettingsError
from basetree.program.console import tell

_FILE = "plot.png"


def plot(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...", help="Folder of a training; several are compared in one plot."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="PICTURE",
            help="PNG file to write.",
            show_default="plot.png in the (first) folder",
        ),
    ] = None,
) -> None:
    """Plot losses, learning rate, speed and AP of a training from its log."""
    from basetree.files.writing import write_whole
    from perceptree.training.plot import draw_runs

    out = out or runs[0] / _FILE
    if out.suffix.lower() != ".png":
        raise SettingsError(f"--out is {out}: expected a name ending in .png")
    write_whole(out, draw_runs(runs))
    tell(out)
