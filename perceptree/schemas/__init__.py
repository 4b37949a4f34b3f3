"""JSON Schema (draft 2020-12) of the JSON that `perceptree` writes, made from types.

from perceptree.schemas import json_schema, schema_names

schema = json_schema("perceptree.evaluation/1")
"""

from perceptree.schemas.catalogue import json_schema, schema_names

__all__ = ["json_schema", "schema_names"]
