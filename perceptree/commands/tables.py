"""``perceptree tables``: reproduce the paper's tables 2 and 3 at a chosen scale."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from basetree.errors import SettingsError
from perceptree.commands.progress import TrainingBar, say

if TYPE_CHECKING:
    from perceptree.tables import Watch

_Table = Annotated[
    int,
    typer.Option(
        help="2: three backbones on RGB and depth. 3: with and without masks and keypoints."
    ),
]
_Model = Annotated[
    str | None,
    typer.Option(
        help="Model; for table 2 several, separated by commas. By default edge-n, for table 2 the"
        " paper's r50,r101,x101-32x8d."
    ),
]
_Modality = Annotated[
    str | None,
    typer.Option(
        help="Modality of table 3: depth (the default) or rgb; the other is trained for comparison."
    ),
]
_Init = Annotated[
    str | None,
    typer.Option(
        help="Starting weights: imagenet, coco, or a checkpoint, in whose name {model} and"
        " {modality} are replaced. By default random."
    ),
]
_Side = Annotated[int | None, typer.Option(help="Size of the input in px; by default the model's.")]
_Test = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Dataset with the test frames; by default DATA."),
]


def tables(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="Folder of a dataset.")],
    out: Annotated[
        Path,
        typer.Option(
            metavar="FOLDER",
            help="Folder of the runs and the tables; finished runs are kept.",
        ),
    ],
    table: _Table,
    model: _Model = None,
    modality: _Modality = None,
    minutes: Annotated[float | None, typer.Option(help="Training time per run in minutes.")] = None,
    steps: Annotated[int | None, typer.Option(help="Steps per run, instead of minutes.")] = None,
    seeds: Annotated[
        str, typer.Option(help="Seeds, separated by commas; every model is trained with each.")
    ] = "0,1",
    recipe: Annotated[
        str | None,
        typer.Option(help="Training recipe: scratch, varied or paper; by default the model's."),
    ] = None,
    init: _Init = None,
    height: _Side = None,
    width: _Side = None,
    batch: Annotated[int | None, typer.Option(help="Frames per step. [8]")] = None,
    test: _Test = None,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    precision: Annotated[str, typer.Option(help="fp32, bf16, or auto (the faster one).")] = "auto",
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Train and evaluate the models of one of the paper's tables; print ours and the paper's.

    Continues where it was interrupted.
    """
    from perceptree.tables import TableSettings, build_table, table_lines
    from perceptree.training import Engine

    if table == 2 and modality is not None:
        raise SettingsError(f"--modality is {modality!r}: table 2 has both, expected no --modality")
    settings = TableSettings(
        table=table,
        models=tuple(model.split(",")) if model else (),
        modality=modality or "depth",  # type: ignore[arg-type]
        seeds=_numbers(seeds),
        steps=steps,
        minutes=minutes,
        recipe=recipe,
        init=init,
        height=height,
        width=width,
        batch=batch,
    )
    engine = Engine(device=device, precision=precision)  # type: ignore[arg-type]
    record = build_table(settings, data, test or data, out, engine, _watch(not as_json))
    if as_json:
        typer.echo(json.dumps(record))
        return
    for line in table_lines(record):
        typer.echo(line)
    typer.echo(f"\n{out / 'tables.md'}")


def _numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise SettingsError(
            f"--seeds is {text!r}: expected integers, separated by commas"
        ) from None


def _watch(shown: bool) -> Watch:
    """Return callbacks that report the runs and their progress on stderr."""
    from perceptree.tables import Watch
    from perceptree.training import Preparing

    printed: set[str] = set()

    def tell_run(name: str, number: int, total: int) -> None:
        if shown:
            typer.echo(f"run {number} of {total}: {name}", err=True)

    def say_once(line: str) -> None:
        if line not in printed:  # every run reads the same data
            printed.add(line)
            say(line)

    preparing = Preparing(_counter("caching", shown), say_once)
    return Watch(tell_run, TrainingBar(shown), preparing, _counter("evaluating", shown))


def _counter(label: str, shown: bool) -> Callable[[int, int], None]:
    """Return a callback that counts frames in one line of a terminal."""

    def tell(done: int, total: int) -> None:
        if shown and sys.stderr.isatty():
            end = "\n" if done == total else ""
            sys.stderr.write(f"\r\x1b[2K{label} frames: {done} of {total}{end}")
            sys.stderr.flush()

    return tell
