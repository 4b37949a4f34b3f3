"""Settings: dataclasses whose fields say once what they mean and what they may be.

    from dataclasses import dataclass, field

    from basetree.settings import Settings, limits

    @dataclass(frozen=True)
    class LampSettings(Settings):
        reach_m: float = field(default=5.0, metadata=limits(0.5, 40))
        \"\"\"Distance at which the lamp lights a surface in middle grey, m.\"\"\"

From the default, the metadata and the docstring of a field come the check of its value, its option
on the command line (`basetree.program.options`), its entry in the reference, and its JSON Schema.
"""

from basetree.settings.base import Settings, check_value
from basetree.settings.json_schema import json_schema
from basetree.settings.metadata import (
    NOT_AN_OPTION,
    UNORDERED,
    label,
    limits,
    names,
    option,
    shown_default,
    weights,
)
from basetree.settings.words import field_words

__all__ = [
    "NOT_AN_OPTION",
    "UNORDERED",
    "Settings",
    "check_value",
    "field_words",
    "json_schema",
    "label",
    "limits",
    "names",
    "option",
    "shown_default",
    "weights",
]
