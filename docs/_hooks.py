"""Hooks of mkdocs: pages that are generated, so that they always match the code.

In a page, a line `<!-- commands: edgetree -->` becomes the help of every command of that program,
and `<!-- api: calib.boards -->` the reference of every name in that package's `__all__`. With
`except PACKAGE`, names that are also in the `__all__` of that package are left out.

A line `<!-- schemas: edgetree -->` becomes the list of the JSON Schemas of a program.

A line `<!-- constants: measure -->` becomes the tables of the measurement's constants. In the text,
`{{LITTER_STD_M}}` becomes the value of a constant or of a field of `MeasureSettings`, and
`{{LITTER_STD_M cm}}` the value in another unit (%, cm or mm) with that unit.

In the finished page, options, names with hyphens, and numbers with their units stay on one line.
"""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parents[1]
_HELP_COLUMNS = 88
_UNITS = {"": 1.0, "%": 100.0, "cm": 100.0, "mm": 1000.0}
_TAG = re.compile(r"(<[^>]*>)")
_HYPHENED = re.compile(r"[\w.-]*-[\w.-]*\w")
_LONGEST = 26  # characters of a word with hyphens that fits every column
_NUMBER = re.compile(
    r"(?<=\d) (?=(?:%|°|degrees|px|mm|cm|m|km|ms|s|min|Hz|[kMG]i?B|million)(?![\w/]))|(?<=±) (?=\d)"
)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace the markers of a page; called by mkdocs for each page."""
    markdown = re.sub(
        r"^<!-- commands: (\w+) -->$",
        lambda found: "\n".join(_command_sections(found[1])),
        markdown,
        flags=re.MULTILINE,
    )
    markdown = re.sub(
        r"^<!-- constants: measure -->$",
        lambda _: "\n".join(_constant_tables()),
        markdown,
        flags=re.MULTILINE,
    )
    markdown = re.sub(
        r"^<!-- schemas: (\w+) -->$",
        lambda found: "\n".join(_schema_table(found[1])),
        markdown,
        flags=re.MULTILINE,
    )
    markdown = re.sub(r"\{\{(\w+) ?(%|cm|mm|)\}\}", lambda found: _value(*found.groups()), markdown)
    return re.sub(
        r"^<!-- api: ([\w.]+)(?: except ([\w.]+))? -->$",
        lambda found: "\n".join(_api_directives(found[1], found[2])),
        markdown,
        flags=re.MULTILINE,
    )


def on_page_content(html: str, **_: Any) -> str:
    """Keep options, and numbers with their units, on one line; called by mkdocs for each page."""
    done, code = [], 0
    for part in _TAG.split(html):
        if part.startswith("<"):
            code += part.startswith("<code") - part.startswith("</code")
            done.append(part)
        elif code:
            done.append(_HYPHENED.sub(_unbroken, part))
        else:
            done.append(_NUMBER.sub("\N{NO-BREAK SPACE}", part))
    return "".join(done)


def _unbroken(found: re.Match[str]) -> str:
    word = found[0]
    return f'<span class="whole">{word}</span>' if len(word) <= _LONGEST else word


def _command_sections(program: str) -> Iterator[str]:
    """A heading and the help text for every command of a program, in their order."""
    import typer

    app = importlib.import_module(f"{program}.cli").app
    for words, text in _helps(typer.main.get_command(app), (program,)):
        yield f"## {' '.join(words)}\n\n```text\n{text.rstrip()}\n```\n"


def _helps(
    command: Any, words: tuple[str, ...], parent: Any = None
) -> Iterator[tuple[tuple[str, ...], str]]:
    """The words to type and the help text, for a command and its sub-commands."""
    context = command.make_context(
        words[-1], [], parent, resilient_parsing=True, terminal_width=_HELP_COLUMNS
    )
    yield words, re.sub(r"\x1b\[[0-9;]*m", "", command.get_help(context))
    for name, child in getattr(command, "commands", {}).items():
        yield from _helps(child, (*words, name), context)


def _constant_tables() -> Iterator[str]:
    """A heading and a table for each topic of the measurement's constants."""
    from edgetree.measure.constants.entries import TOPICS, entries

    for topic, module in TOPICS.items():
        yield f"### {topic}\n"
        yield "| Constant | Value | What it stands for | Source |\n| --- | --- | --- | --- |"
        for entry in entries(module):
            yield f"| `{entry.name}` | {entry.value:.4g} | {entry.meaning} | {entry.source} |"
        yield ""


def _schema_table(program: str) -> Iterator[str]:
    """A row for each JSON Schema of a program: its name, what it is of, and its keys."""
    schemas = importlib.import_module(f"{program}.schemas")

    yield "| Schema | What has it, and its keys (in italics if not always there) |\n| --- | --- |"
    for name in schemas.schema_names():
        schema = schemas.json_schema(name)
        made = schema["$defs"][schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema
        words = " ".join(made.get("description", "").partition("\n\n")[0].split())
        required = made.get("required", ())
        keys = [
            f"`{key}`" if key in required else f"*`{key}`*"
            for key in made.get("properties", ())
            if key != "schema"
        ]
        yield f"| `{name}` | {words}<br>{', '.join(keys)} |"


def _value(name: str, unit: str) -> str:
    """The value of a constant or of a setting of the measurement, in a unit."""
    from edgetree.measure import MeasureSettings
    from edgetree.measure.constants.entries import TOPICS

    places: list[Any] = [MeasureSettings(), *TOPICS.values()]
    values = [getattr(place, name) for place in places if hasattr(place, name)]
    if not values:
        raise ValueError(f"{{{{{name}}}}}: expected a constant or a setting of the measurement")
    return f"{values[0] * _UNITS[unit]:.3g} {unit}".rstrip()


def _api_directives(package: str, other: str | None) -> Iterator[str]:
    """A directive of mkdocstrings for every public name of a package, in the order of `__all__`."""
    known = [] if other is None else _public_names(other)
    for name in _public_names(package):
        if name not in known:
            yield f"::: {package}.{name}\n"


def _public_names(package: str) -> list[str]:
    """The names in a package's `__all__`, read without importing it."""
    folder = _ROOT / package.replace(".", "/")
    path = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return list(ast.literal_eval(node.value))
    raise ValueError(f"{path}: expected an assignment to __all__")
