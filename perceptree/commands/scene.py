"""`perceptree scene`: export one simulated scene to a 3D file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from basetree.counts import counted
from basetree.errors import SettingsError
from basetree.program.console import tell
from perceptree.commands.synth import chosen_preset


def scene(
    out: Annotated[Path, typer.Option(help="File to write, ending in .glb.")],
    seed: Annotated[
        int, typer.Option(help="Seed of the scene, as in the scene field of a dataset's frames.")
    ] = 0,
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Preset: paper, field, vegetation, drive, plain, test, field-test.",
            show_default="field",
        ),
    ] = None,
) -> None:
    """Export the scene of one seed as binary glTF: ground, named trees, undergrowth."""
    if out.suffix != ".glb":
        raise SettingsError(f"--out is {out}: expected a name ending in .glb")
    if seed < 0:
        raise SettingsError(f"--seed is {seed}: expected at least 0")
    settings = chosen_preset(preset).settings
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingsError(
            f"--out is {out}: cannot create its folder ({error.strerror}), expected a writable one"
        ) from error

    from perceptree.simulator.geometry.gltf import export_scene

    trees, faces = export_scene(out, settings, seed)
    tell(f"{out}: {counted(trees, 'tree')}, {counted(faces, 'triangle')}, metres, y up")
    tell("open it in Blender (File, Import, glTF 2.0) or at https://gltf-viewer.donmccurdy.com")
