"""`edgetree schema`: JSON Schema of the formats."""

from __future__ import annotations

import json
from typing import Annotated, TypeAlias

import typer

from basetree.program.console import note, tell

_Name: TypeAlias = Annotated[
    str | None,
    typer.Argument(
        metavar="[NAME]",
        help="What a JSON object gives as its `schema`, such as edgetree.frame/1. Without it, the"
        " names are listed.",
    ),
]


def schema(name: _Name = None) -> None:
    """Print the JSON Schema (draft 2020-12) of a format, for validators and code generators."""
    from edgetree.schemas import json_schema, schema_names

    if name is None:
        for each in schema_names():
            tell(each)
        note("next: edgetree schema edgetree.frame/1 > frame.schema.json", whole=True)
        return
    tell(json.dumps(json_schema(name), indent=2))
