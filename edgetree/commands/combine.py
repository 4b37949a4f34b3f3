"""`edgetree combine`: one model file for colour and depth, colour alone, and depth alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from basetree.counts import counted
from basetree.program.console import note, tell
from basetree.program.progress import steps_shown
from basetree.program.quoting import quoted


def combine(
    both: Annotated[
        str,
        typer.Argument(metavar="MODEL", help="A model of colour and depth: a file or a name."),
    ],
    *,
    colour: Annotated[
        str,
        typer.Option(metavar="MODEL", help="A model of colour, for frames without depth."),
    ],
    depth: Annotated[
        str,
        typer.Option(metavar="MODEL", help="A model of depth, for frames without colour."),
    ],
    out: Annotated[Path, typer.Option(help="The .onnx file to write.")],
) -> None:
    """Put three models into one file, which runs the one for the images that a frame has.

    Shown only one of the two images, a model of colour and depth finds less than a model that was
    trained for that image. All three need the same input size and precision, and one frame at a
    time. The file is written only if it finds exactly what each of them finds.
    """
    from basetree.files.places import check_folders, check_paths
    from edgetree.catalogue import find_model
    from edgetree.export import combine_models

    files = {"MODEL": both, "--colour": colour, "--depth": depth}
    check_paths({"--out": out}, {name: find_model(model) for name, model in files.items()})
    check_folders([out])
    with steps_shown("reading the files") as say:
        made = combine_models(both, colour, depth, out, say)
    tell(
        f"{made.path} ({made.file_bytes / 1e6:.1f} MB) finds what the three files find, on"
        f" {counted(made.frames, 'frame')}"
    )
    note(f"next: edgetree bench {quoted(made.path)}", whole=True)
