"""Groups of options that several commands share, declared once as a dataclass."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any, get_type_hints

__all__ = ["expand_groups"]


def expand_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Let a typer command take dataclasses of options.

    typer makes one option of each parameter of a function. This decorator replaces each parameter
    that is annotated with a dataclass by the fields of that dataclass, and passes the command an
    instance of it. Fields are declared like parameters of a command: annotated with
    `typer.Option`, and with a default. The group itself has no default, so it must be a
    keyword-only parameter of the command.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(command).parameters.values():
        hint = hints[parameter.name]
        if parameter.name in groups:
            parameters += _parameters_of(hint)
        else:
            parameters.append(parameter.replace(annotation=hint))

    @wraps(command)
    def expanded(**values: Any) -> None:
        for name, group in groups.items():
            names = [field.name for field in fields(group)]
            values[name] = group(**{each: values.pop(each) for each in names})
        command(**values)

    expanded.__dict__["__signature__"] = inspect.Signature(parameters)
    expanded.__annotations__ = {each.name: each.annotation for each in parameters}
    return expanded


def _parameters_of(group: Any) -> list[inspect.Parameter]:
    """The fields of a dataclass as parameters of a function."""
    hints = get_type_hints(group, include_extras=True)
    return [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=field.default,
            annotation=hints[field.name],
        )
        for field in fields(group)
    ]
