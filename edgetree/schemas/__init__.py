"""JSON Schema (draft 2020-12) of the JSON that the commands write, made from types.

from edgetree.schemas import json_schema, schema_names

schema = json_schema("edgetree.frame/1")
"""

from edgetree.schemas.catalogue import json_schema, schema_names

__all__ = ["json_schema", "schema_names"]
