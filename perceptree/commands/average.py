"""`perceptree average`: the mean of several checkpoints' weights."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from basetree.program.console import tell
from perceptree.commands.options import check_checkpoint_name
from perceptree.errors import CheckpointError


def average(
    checkpoints: Annotated[
        list[Path], typer.Argument(help="Two or more checkpoints of trainings with one start.")
    ],
    out: Annotated[Path, typer.Option(help="Checkpoint to write.")],
    weights: Annotated[
        str | None,
        typer.Option(
            help="Shares such as 2,1,1, in the order of the files.", show_default="equal shares"
        ),
    ] = None,
) -> None:
    """Average the weights of trainings that began with the same weights.

    The mean often keeps what each of them learned (Wortsman et al. 2022, Model soups).
    """
    from perceptree.models import save_checkpoint
    from perceptree.training.soup import average_checkpoints

    check_checkpoint_name(out)
    model, record = average_checkpoints(checkpoints, _shares(weights, len(checkpoints)))
    save_checkpoint(out, model, record)
    tell(f"checkpoint: {out}")


def _shares(text: str | None, count: int) -> list[float]:
    if count < 2:
        raise CheckpointError(f"{count} checkpoint is given: expected two or more to average")
    if text is None:
        return [1.0] * count
    try:
        shares = [float(part) for part in text.split(",")]
    except ValueError:
        shares = []
    if len(shares) != count or not all(0 < share < float("inf") for share in shares):
        raise CheckpointError(
            f"--weights is {text!r}: expected {count} numbers over 0 with commas between them"
        )
    return shares
