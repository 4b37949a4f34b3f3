"""What the commands `schema` of the programs print."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Annotated, Any, TypeAlias

import typer

from basetree.program.console import note, print_json, tell

SchemaName: TypeAlias = Annotated[
    str | None,
    typer.Argument(
        metavar="[NAME]",
        help="What a JSON object gives as its `schema`. Without it, the names are listed.",
    ),
]


def print_schema(
    name: str | None, names: Iterable[str], make: Callable[[str], dict[str, Any]], example: str
) -> None:
    """Print a JSON Schema, or list the names with an example of the command."""
    if name is not None:
        print_json(make(name), indent=2)
        return
    for each in names:
        tell(each)
    note(f"next: {example}", whole=True)
