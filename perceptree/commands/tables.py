"""``perceptree tables``: the paper's tables 2 and 3 at a chosen scale."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from perceptree.commands.progress import TrainingBar, say
from perceptree.errors import SettingsError

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
        help="Model, for table 2 several by commas; by default edge-n, for table 2 the paper's"
        " r50,r101,x101-32x8d."
    ),
]
_Modality = Annotated[
    str | None,
    typer.Option(help="Of table 3: depth (the default) or rgb; the other is trained beside it."),
]
_Init = Annotated[
    str | None,
    typer.Option(
        help="Starting weights: imagenet, coco, or a checkpoint, in whose name {model} and"
        " {modality} are filled in. Random without."
    ),
]
_Side = Annotated[int | None, typer.Option(help="Of the input, px; by default the model's own.")]
_Test = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Dataset whose test frames are evaluated; by default DATA."),
]


def tables(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="Folder of a dataset.")],
    out: Annotated[
        Path,
        typer.Option(
            metavar="FOLDER",
            help="Folder of the runs and the tables; what is finished there stays.",
        ),
    ],
    table: _Table,
    model: _Model = None,
    modality: _Modality = None,
    minutes: Annotated[float | None, typer.Option(help="Training time of a run.")] = None,
    steps: Annotated[int | None, typer.Option(help="Or the steps of a run.")] = None,
    seeds: Annotated[str, typer.Option(help="Each run once for each seed.")] = "0,1",
    recipe: Annotated[
        str | None, typer.Option(help="scratch or paper; by default that of the model.")
    ] = None,
    init: _Init = None,
    height: _Side = None,
    width: _Side = None,
    batch: Annotated[int | None, typer.Option(help="Frames per step. [8]")] = None,
    test: _Test = None,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    precision: Annotated[str, typer.Option(help="fp32, bf16, or auto: the faster one.")] = "auto",
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Train and evaluate the models of a table of the paper, and print ours beside the paper's.

    Goes on where it was stopped.
    """
    from perceptree.tables import TableSettings, build_table, table_lines
    from perceptree.training import Engine

    if table == 2 and modality is not None:
        raise SettingsError(f"--modality is {modality!r}: table 2 has both, expected none")
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
            f"--seeds is {text!r}: expected whole numbers, separated by commas"
        ) from None


def _watch(shown: bool) -> Watch:
    """Tells on stderr which run it is and where it stands."""
    from perceptree.tables import Watch
    from perceptree.training import Preparing

    said: set[str] = set()

    def tell_run(name: str, number: int, total: int) -> None:
        if shown:
            typer.echo(f"run {number} of {total}: {name}", err=True)

    def say_once(line: str) -> None:
        if line not in said:  # every run reads the same data
            said.add(line)
            say(line)

    preparing = Preparing(_counter("caching", shown), say_once)
    return Watch(tell_run, TrainingBar(shown), preparing, _counter("evaluating", shown))


def _counter(label: str, shown: bool) -> Callable[[int, int], None]:
    """Counts frames in one line of a terminal."""

    def tell(done: int, total: int) -> None:
        if shown and sys.stderr.isatty():
            end = "\n" if done == total else ""
            sys.stderr.write(f"\r\x1b[2K{label} frames: {done} of {total}{end}")
            sys.stderr.flush()

    return tell
