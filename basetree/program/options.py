"""Options of commands: in groups that are dataclasses, and from the fields of settings."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import wraps
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import typer
from typer.models import OptionInfo

from basetree.settings.base import metadata_of
from basetree.settings.words import field_words


def expand_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Let a typer command take dataclasses of options.

    typer makes one option of each parameter of a function. This decorator replaces each parameter
    that is annotated with a dataclass by the fields of that dataclass, and passes the command an
    instance of it. The group itself has no default, so it must be a keyword-only parameter of the
    command. The options are, in this order of preference:

    - what a field is annotated with, `typer.Option` as for a parameter of a command
    - as `option_of` makes it from the field of the same name of the class that the group names as
      `fields_of`
    - as `option_of` makes it from the field itself, so that a class of settings is a group too

    A group may name an `option_prefix` such as "mqtt_" that goes before the names of its fields.
    In the help they stand under the heading that the class names as `panel`.
    """
    hints = get_type_hints(command, include_extras=True)
    members: dict[str, list[str]] = {}
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(command).parameters.values():
        hint = hints[parameter.name]
        if is_dataclass(hint):
            fields_of_group = list(_parameters_of(hint))
            members[parameter.name] = [each.name for each in fields_of_group]
            parameters += fields_of_group
        else:
            parameters.append(parameter.replace(annotation=hint))

    @wraps(command)
    def expanded(**values: Any) -> None:
        for group, names in members.items():
            prefix = getattr(hints[group], "option_prefix", "")
            given = {name.removeprefix(prefix): values.pop(name) for name in names}
            values[group] = hints[group](**given)
        command(**values)

    expanded.__dict__["__signature__"] = inspect.Signature(parameters)
    expanded.__annotations__ = {each.name: each.annotation for each in parameters}
    return expanded


def option_of(settings: type, name: str, *, default: str = "") -> Any:
    """Make the typer option of a field of settings.

    Its help is the docstring of the field with the limits and the default. Values out of range are
    refused by the settings, when they are built.

    Args:
        settings: Class of the settings.
        name: Name of the field.
        default: What applies if the option is not given; by default the default of the field.
    """
    (entry,) = (each for each in fields(settings) if each.name == name)
    metadata = metadata_of(settings, entry)
    names, metavar = metadata.get("option", ((), None))
    metavar = "NAME" if metavar is None and "names" in metadata else metavar
    notes = [metadata["expected"]] if "expected" in metadata else []
    default = default or metadata.get("shown_default") or _default(entry)
    notes += [f"default: {default}"] if default else []
    words = field_words(settings).get(name, "").replace("`", "")
    help_text = f"{words} [{'; '.join(notes)}]" if notes else words
    return typer.Option(*names, metavar=metavar, help=help_text, show_default=False)


def given(options: Any, settings: type) -> dict[str, Any]:
    """The options of a group that are fields of settings, without those that were not typed."""
    names = {entry.name for entry in fields(settings)}
    return {
        entry.name: getattr(options, entry.name)
        for entry in fields(options)
        if entry.name in names and getattr(options, entry.name) is not None
    }


def _parameters_of(group: Any) -> Iterator[inspect.Parameter]:
    """The fields of a dataclass as parameters of a function."""
    hints = get_type_hints(group, include_extras=True)
    source, prefix = getattr(group, "fields_of", group), getattr(group, "option_prefix", "")
    for entry in fields(group):
        hint = hints[entry.name]
        if get_origin(hint) is not Annotated:
            if entry.metadata.get("option", ()) is None:
                continue
            hint = Annotated[_typed(hint), option_of(source, entry.name)]
        kind = inspect.Parameter.KEYWORD_ONLY
        if heading := getattr(group, "panel", ""):
            hint = _under(heading, hint)
        yield inspect.Parameter(prefix + entry.name, kind, default=entry.default, annotation=hint)


def _under(heading: str, hint: Any) -> Any:
    """The annotation of an option, which stands under a heading of the help if it has none yet."""
    kind, *known = get_args(hint)
    for index, each in enumerate(known):
        if isinstance(each, OptionInfo) and each.rich_help_panel is None:
            known[index] = copy(each)
            known[index].rich_help_panel = heading
    return Annotated[(kind, *known)]


def _typed(hint: Any) -> Any:
    """The type of a typed value; names are checked by the settings, not by typer."""
    return type(get_args(hint)[0]) if get_origin(hint) is Literal else hint


def _default(entry: Field[Any]) -> str:
    """The default of a field in words; empty for none and for a switch that is off."""
    value = entry.default
    if value is None or value is False or value is MISSING:
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value)
