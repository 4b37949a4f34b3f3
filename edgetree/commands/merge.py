"""`edgetree merge`: join what `run` or `measure` wrote with --shard."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from edgetree.commands.options import Csv, Json, Profiles
from edgetree.commands.sharding import print_merged

_Shards: TypeAlias = Annotated[
    list[Path],
    typer.Argument(metavar="SHARDS...", help="Folders or URLs of the shards of one job."),
]
_JsonLines: TypeAlias = Annotated[
    Path | None, typer.Option(help="File for the JSON lines, instead of stdout.")
]


def merge(
    shards: _Shards,
    *,
    jsonl: _JsonLines = None,
    csv: Csv = None,
    profiles: Profiles = None,
    as_json: Json = False,
) -> None:
    """Join what `run` or `measure` wrote with --shard; may be repeated.

    The results are, row for row, those of one machine.
    """
    from basetree.files.places import check_paths
    from basetree.jobs import open_store, read_manifests
    from edgetree.shards.merging import Outputs, merge_frames
    from edgetree.shards.work import KIND

    outputs = Outputs(jsonl, csv, profiles)
    check_paths({f"--{name}": path for name, path in vars(outputs).items()}, {})
    parts = read_manifests([open_store(where) for where in shards], (KIND,))
    print_merged(merge_frames(parts, outputs, lines_to_stdout=not as_json), outputs, as_json)
