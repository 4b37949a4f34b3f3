"""`perceptree tables`: reproduce the paper's tables 2 and 3 at a chosen scale."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from basetree.errors import SettingsError
from basetree.program.console import note, print_found
from basetree.program.options import expand_groups, given
from basetree.program.progress import counter
from perceptree.commands.options import Json, Side
from perceptree.commands.progress import TrainingBar, say
from perceptree.settings.training import Engine, TrainSettings

if TYPE_CHECKING:
    from perceptree.tables import Watch


@dataclass(frozen=True)
class TableModels:
    """The models of a table."""

    model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Model; for table 2 several, separated by commas.",
            show_default="edge-n, for table 2 the paper's r50,r101,x101-32x8d",
        ),
    ] = None
    modality: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Modality of table 3: depth or rgb; the other is trained for comparison.",
            show_default="depth",
        ),
    ] = None
    init: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="Starting weights: imagenet, coco, or a checkpoint, in whose name {model} and"
            " {modality} are replaced.",
            show_default="random",
        ),
    ] = None
    height: Side = None
    width: Side = None


@dataclass(frozen=True)
class TableRuns:
    """How each model of a table is trained."""

    fields_of = TrainSettings

    minutes: float | None = None
    steps: int | None = None
    seeds: Annotated[
        str, typer.Option(help="Seeds, separated by commas; every model is trained with each.")
    ] = "0,1"
    recipe: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Training recipe: scratch, varied or paper.",
            show_default="the model's",
        ),
    ] = None
    batch: int | None = None


@dataclass(frozen=True)
class TableMachine:
    """The machine that trains."""

    fields_of = Engine

    device: str = "cpu"
    precision: str = "auto"


@expand_groups
def tables(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="Folder of a dataset.")],
    out: Annotated[
        Path,
        typer.Option(
            metavar="FOLDER",
            help="Folder of the runs and the tables; finished runs are kept.",
        ),
    ],
    table: Annotated[
        int,
        typer.Option(
            help="2: three backbones on RGB and depth. 3: with and without masks and keypoints."
        ),
    ],
    *,
    models: TableModels,
    runs: TableRuns,
    test: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Dataset with the test frames.", show_default="DATA"),
    ] = None,
    machine: TableMachine,
    as_json: Json = False,
) -> None:
    """Train and evaluate the models of one of the paper's tables; print ours and the paper's.

    Continues where it was interrupted.
    """
    from perceptree.tables import TableSettings, build_table, table_lines

    if table == 2 and models.modality is not None:
        raise SettingsError(
            f"--modality is {models.modality!r}: table 2 has both, expected no --modality"
        )
    settings = TableSettings(
        table=table,
        models=tuple(models.model.split(",")) if models.model else (),
        **given(models, TableSettings)
        | given(runs, TableSettings)
        | {"seeds": _numbers(runs.seeds)},
    )
    engine = Engine(**given(machine, Engine))
    record = build_table(settings, data, test or data, out, engine, _watch(not as_json))
    page = f"\n{out / 'tables.md'}"
    values = {"schema": "perceptree.table/1", **record}
    print_found(as_json, lambda: values, lambda: [*table_lines(record), page])


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
            note(f"run {number} of {total}: {name}")

    def say_once(line: str) -> None:
        if line not in printed:  # every run reads the same data
            printed.add(line)
            say(line)

    preparing = Preparing(counter("caching frames", shown=shown), say_once)
    return Watch(tell_run, TrainingBar(shown), preparing, counter("evaluating frames", shown=shown))
