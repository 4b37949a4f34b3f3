"""`perceptree merge`: join the shards of a simulation or an evaluation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from basetree.errors import SettingsError
from perceptree.commands.eval import print_report
from perceptree.commands.options import Json
from perceptree.commands.synth_result import print_result

_SYNTH, _EVAL = "perceptree.synth", "perceptree.eval"


def merge(
    shards: Annotated[
        list[Path],
        typer.Argument(metavar="SHARDS...", help="Folders or URLs of the shards of one job."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder or URL of the dataset, or folder of the report.",
            show_default="a dataset is completed where its shards are, of an evaluation only the"
            " summary is printed",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Join what `synth` or `eval` wrote with --shard; may be repeated.

    A dataset is byte for byte the one that a single machine makes.
    """
    from basetree.jobs import open_store, read_manifests

    stores = [open_store(where) for where in shards]
    parts = read_manifests(stores, (_SYNTH, _EVAL))
    if parts.job.kind == _EVAL:
        from perceptree.evaluation import report_folder
        from perceptree.evaluation.shards import merge_evaluation

        if out is not None:
            report_folder(out)
        print_report(*merge_evaluation(parts, out), as_json)
        return
    from perceptree.simulator.dataset.shards import merge_dataset

    if out is None and len(stores) > 1:
        raise SettingsError(
            f"--out is missing: expected a folder or URL to join {len(stores)} into"
        )
    print_result(merge_dataset(parts, stores[0] if out is None else open_store(out)), as_json)
