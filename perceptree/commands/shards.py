"""Options and steps that commands share when they work on several machines."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from basetree.errors import SettingsError

if TYPE_CHECKING:
    from basetree.jobs import Shard, Store

ShardOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--shard",
        metavar="I/N",
        help="Do only the I-th of N shares of the work, such as 3/64; `merge` joins them.",
    ),
]
RayOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--ray",
        metavar="ADDRESS|local",
        help="Share the work out on a cluster of Ray, or on this machine's cores by Ray.",
    ),
]


ShardsOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--shards",
        metavar="FOLDER|URL",
        help="Where finished parts are kept, for --shard and --ray: a folder, or an object store"
        " such as s3://bucket/folder.",
    ),
]


def chosen_shard(text: str | None, ray: str | None) -> Shard:
    """The shard of the option --shard; the only one if it is not given.

    Raises:
        JobError: If the text is not a shard.
        SettingsError: If Ray is to do the work too.
    """
    from basetree.jobs import Shard

    if text is not None and ray is not None:
        raise SettingsError("--shard given with --ray: expected one of them")
    return Shard() if text is None else Shard.parse(text)


def opened_store(where: Path, ray: str | None) -> Store:
    """The store at a folder or URL; folders are absolute if processes of Ray write to them."""
    from basetree.jobs import is_url, open_store

    return open_store(where.absolute() if ray is not None and not is_url(where) else where)


def location(where: Path) -> str:
    """A folder or URL as the user typed it; a Path reduces the two slashes of a URL to one."""
    from basetree.jobs import is_url, open_store

    return open_store(where).where if is_url(where) else str(where)


def print_shard(store: Store, shard: Shard, as_json: bool) -> None:
    """Print where a finished shard is, and what to do next."""
    values = {"store": store.where, "shard": str(shard), "manifest": shard.file}
    lines = [
        f"shard {shard}: {store.where}/{shard.file}",
        f"next, when all shards are finished: perceptree merge {store.where}",
    ]
    typer.echo(json.dumps(values) if as_json else "\n".join(lines))
