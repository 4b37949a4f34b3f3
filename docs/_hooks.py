"""Hooks of mkdocs: pages that are generated, so that they always match the code.

In a page, a line `<!-- commands: edgetree -->` becomes the help of every command of that program,
and `<!-- api: calib.boards -->` the reference of every name in that package's `__all__`. With
`except PACKAGE`, names that are also in the `__all__` of that package are left out.
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


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace the markers of a page; called by mkdocs for each page."""
    markdown = re.sub(
        r"^<!-- commands: (\w+) -->$",
        lambda found: "\n".join(_command_sections(found[1])),
        markdown,
        flags=re.MULTILINE,
    )
    return re.sub(
        r"^<!-- api: ([\w.]+)(?: except ([\w.]+))? -->$",
        lambda found: "\n".join(_api_directives(found[1], found[2])),
        markdown,
        flags=re.MULTILINE,
    )


def _command_sections(program: str) -> Iterator[str]:
    """A heading and the help text for every command of a program, in their order."""
    import typer

    app = importlib.import_module(f"{program}.cli").app
    for words, text in _helps(typer.main.get_command(app), (program,)):
        yield f"## {' '.join(words)}\n\n```text\n{text.rstrip()}\n```\n"


def _helps(command: Any, words: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], str]]:
    """The words to type and the help text, for a command and its sub-commands."""
    context = command.make_context(
        " ".join(words), [], resilient_parsing=True, terminal_width=_HELP_COLUMNS
    )
    yield words, command.get_help(context)
    for name, child in getattr(command, "commands", {}).items():
        yield from _helps(child, (*words, name))


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
