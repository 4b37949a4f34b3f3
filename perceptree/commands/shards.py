"""Options and steps that commands share when they work on several machines."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from basetree.errors import SettingsError
from basetree.program.console import print_found
from basetree.program.quoting import quoted

if TYPE_CHECKING:
    from basetree.jobs import Shard, Store


@dataclass(frozen=True)
class ShareOptions:
    """How a work is shared out between machines."""

    panel = "Several machines"

    shard: Annotated[
        str | None,
        typer.Option(
            metavar="I/N",
            help="Do only the I-th of N shares of the work, such as 3/64; `merge` joins them.",
        ),
    ] = None
    ray: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS|local",
            help="Share the work out on a cluster of Ray, or on this machine's cores by Ray.",
        ),
    ] = None

    @property
    def is_given(self) -> bool:
        """Whether the work is shared out."""
        return self.shard is not None or self.ray is not None

    def chosen(self) -> Shard:
        """The shard of the option --shard; the only one if it is not given.

        Raises:
            JobError: If the text is not a shard.
            SettingsError: If Ray is to do the work too.
        """
        from basetree.jobs import Shard

        if self.shard is not None and self.ray is not None:
            raise SettingsError("--shard given with --ray: expected one of them")
        return Shard() if self.shard is None else Shard.parse(self.shard)

    def store(self, where: Path) -> Store:
        """The store at a folder or URL; folders are absolute if processes of Ray write to them."""
        from basetree.jobs import is_url, open_store

        by_ray = self.ray is not None and not is_url(where)
        return open_store(where.absolute() if by_ray else where)


def location(where: Path) -> str:
    """A folder or URL as the user typed it; a Path reduces the two slashes of a URL to one."""
    from basetree.jobs import is_url, open_store

    return open_store(where).where if is_url(where) else str(where)


def print_shard(store: Store, shard: Shard, as_json: bool) -> None:
    """Print where a finished shard is, and what to do next."""
    values = {
        "schema": "edgetree.written-shard/1",
        "store": store.where,
        "shard": str(shard),
        "manifest": shard.file,
    }
    lines = [
        f"shard {shard}: {store.where}/{shard.file}",
        f"next, when all shards are finished: perceptree merge {quoted(store.where)}",
    ]
    print_found(as_json, lambda: values, lambda: lines)
