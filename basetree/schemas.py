"""JSON Schema (draft 2020-12) of formats, made from types, by names such as "calib.camera/1"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final

import msgspec
from msgspec import Meta

from basetree.errors import InputError

DRAFT: Final = "https://json-schema.org/draft/2020-12/schema"
Share = Annotated[float, Meta(ge=0, le=1)]
Count = Annotated[int, Meta(ge=0)]
Side = Annotated[int, Meta(ge=1)]
Sides = Annotated[list[int], Meta(min_length=2, max_length=2)]
Triple = Annotated[list[float], Meta(min_length=3, max_length=3)]
Sha256 = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]


def schema_of(types: Mapping[str, Any], name: str, elsewhere: Mapping[str, str]) -> dict[str, Any]:
    """The JSON Schema of a format.

    Fields of newer versions are allowed, as the programs of this project allow them.

    Args:
        types: The type of each format by its name.
        name: A name; without its number, the newest one.
        elsewhere: Commands that print the formats whose names begin with a word.

    Raises:
        InputError: There is no such format.
    """
    numbers = [full for full in types if full.partition("/")[0] == name]
    full = name if name in types else max(numbers, default="")
    if full:
        return {"$schema": DRAFT, "title": full, **msgspec.json.schema(types[full])}
    command = elsewhere.get(name.partition(".")[0])
    if command is not None:
        raise InputError(f"schema {name!r} is not of this program: expected `{command} {name}`")
    raise InputError(f"schema {name!r} is unknown: expected one of {', '.join(sorted(types))}")
