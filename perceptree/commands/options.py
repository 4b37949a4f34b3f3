"""Options that several commands share, and checks of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from basetree.program.options import option_of
from basetree.program.talking import GENERAL
from perceptree.errors import CheckpointError, DatasetError
from perceptree.settings.training import DataSource, Engine

Json: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print one JSON object.", rich_help_panel=GENERAL)
]
Checkpoint: TypeAlias = Annotated[Path, typer.Argument(help="A .safetensors checkpoint.")]
Device: TypeAlias = Annotated[str, typer.Option(metavar="NAME", help="cpu or cuda.")]
Split: TypeAlias = Annotated[str, typer.Option(metavar="NAME", help="train, val or test.")]
Fold: TypeAlias = Annotated[int | None, option_of(DataSource, "fold")]
EntireTree: TypeAlias = Annotated[bool, option_of(DataSource, "entire_tree")]
CrowdsAsTrees: TypeAlias = Annotated[bool, option_of(DataSource, "crowds_as_trees")]
SkipBroken: TypeAlias = Annotated[bool, option_of(Engine, "skip_broken")]
Side: TypeAlias = Annotated[
    int | None, typer.Option(help="Size of the input in px.", show_default="the model's")
]


def check_split(split: str) -> None:
    """Raise DatasetError if the value of --split is no split."""
    from perceptree.data import SPLITS

    if split not in SPLITS:
        raise DatasetError(f"--split is {split!r}: expected one of {', '.join(SPLITS)}")


def check_checkpoint_name(out: Path) -> None:
    """Raise CheckpointError if the value of --out is not the name of a checkpoint."""
    if out.suffix != ".safetensors":
        raise CheckpointError(f"--out is {out}: expected a file name ending in .safetensors")
