"""`perceptree schema`: JSON Schema of the formats."""

from __future__ import annotations

from basetree.program.schemas import SchemaName, print_schema


def schema(name: SchemaName = None) -> None:
    """Print the JSON Schema (draft 2020-12) of a format, for validators and code generators."""
    from perceptree.schemas import json_schema, schema_names

    example = "perceptree schema perceptree.labels > labels.schema.json"
    print_schema(name, schema_names(), json_schema, example)
