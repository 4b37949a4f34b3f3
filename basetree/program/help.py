"""The help of programs: commands and options in groups, limits and defaults in one style.

It is plain text of at most 100 columns, on a terminal with bold headings: tables of the library
`rich` leave a third of 80 columns to the words, and take as long to load as the program itself.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from textwrap import shorten
from typing import Any, Final, get_args, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup
from typer.models import ArgumentInfo, OptionInfo

from basetree.program.talking import GENERAL, with_talk_options

_WIDEST: Final = 100
_NAME_COLUMNS: Final = 24
_SUGGESTION_COLUMNS: Final = 60
_METAVARS: Final = {Path: "PATH", int: "N", float: "NUMBER", str: "TEXT"}


class App(typer.Typer):
    """A program, or a command with commands of its own, whose help is that of this module.

    The epilog of a command is its example.
    """

    def command(self, name: str | None = None, **settings: Any) -> Callable[..., Any]:
        """As of `typer.Typer`, with the options of `TalkOptions`.

        Values of options are named by their type, such as PATH.
        """
        register = super().command(name, **{"cls": _Command} | settings)

        def add(function: Callable[..., Any]) -> Callable[..., Any]:
            register(_with_metavars(with_talk_options(function)))
            return function

        return add

    def callback(self, *given: Any, **settings: Any) -> Callable[..., Any]:
        """As of `typer.Typer`; values of options are named by their type, such as PATH."""
        register = super().callback(*given, **settings)
        return lambda function: register(_with_metavars(function))

    def add(
        self, function: Callable[..., Any], example: str, *, group: str, name: str | None = None
    ) -> None:
        """Add a command.

        Args:
            function: The command.
            example: A line to copy.
            group: The heading under which the program's help lists it.
            name: Its name; that of the function if not given.
        """
        self.command(name, epilog=example, rich_help_panel=group)(function)


def new_app(about: str, name: str | None = None) -> App:
    """Make an app without commands, of a program or of a command with commands of its own.

    Args:
        about: Its help.
        name: Its name; None if whoever adds it names it.
    """
    return App(
        name=name,
        help=about,
        cls=_Group,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": _WIDEST},
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        add_completion=name is not None,
    )


class _Help:
    """What commands and groups have in common. Options that name a file may be given once."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not ctx.resilient_parsing:
            parser = self.make_parser(ctx)  # type: ignore[attr-defined]
            _, _, given = parser.parse_args(args=list(args))
            asks_for_help = any("--help" in param.opts for param in given)
            for param in () if asks_for_help else given:
                if _takes_one(param) and given.count(param) > 1:
                    ctx.fail(f"{max(param.opts, key=len)} is given twice: expected once")
        rest: list[str] = super().parse_args(ctx, args)  # type: ignore[misc]
        return rest

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        pieces = ["[OPTIONS]"]
        for param in self.get_params(ctx):  # type: ignore[attr-defined]
            if param.param_type_name == "argument":
                word = _argument(param)
                pieces.append(word if param.required or word.startswith("[") else f"[{word}]")
        return pieces

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        found: list[Any] = super().shell_complete(ctx, incomplete)  # type: ignore[misc]
        for each in found:  # a longer help would be wrapped into lines that look like suggestions
            each.help = each.help and shorten(each.help, _SUGGESTION_COLUMNS, placeholder=" ..")
        return found

    def format_options(self, ctx: Any, formatter: Any) -> None:
        groups: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):  # type: ignore[attr-defined]
            if not getattr(param, "hidden", False):
                groups.setdefault(_group(param), []).append((_names(param), _words(param, ctx)))
        groups[GENERAL] = groups.pop(GENERAL, [])
        _write(formatter, groups)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        if example := getattr(self, "epilog", None):
            with formatter.section(_heading("Example")):
                formatter.write("".join(_lines(example, formatter)))


class _Command(_Help, TyperCommand):
    """A command."""


class _Group(_Help, TyperGroup):
    """A program, or a command with commands."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        return [*super().collect_usage_pieces(ctx), self.subcommand_metavar]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        groups: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            if command is not None and not command.hidden:
                group = getattr(command, "rich_help_panel", None) or "Commands"
                words = " ".join((command.help or "").partition("\n\n")[0].split())
                groups.setdefault(group, []).append((name, words))
        _write(formatter, groups)
        super().format_options(ctx, formatter)


def _with_metavars(function: Callable[..., Any]) -> Callable[..., Any]:
    """Name the values of a command's arguments and options that have no name yet."""
    hints = get_type_hints(function, include_extras=True)
    for name, hint in hints.items():
        for each in getattr(hint, "__metadata__", ()):
            if not isinstance(each, ArgumentInfo | OptionInfo) or each.metavar is not None:
                continue
            is_argument = isinstance(each, ArgumentInfo)
            each.metavar = name.upper() if is_argument else _metavar(get_args(hint)[0])
    function.__annotations__ = hints  # typer finds the same objects
    return function


def _metavar(kind: Any) -> str | None:
    """The name of a value by its type, also of `Path | None` or a list; None for a switch."""
    if kind in _METAVARS:
        return _METAVARS[kind]
    return next(filter(None, map(_metavar, get_args(kind))), None)


def _takes_one(param: Any) -> bool:
    """Whether it is an option for a file or folder, of which a second one drops the first."""
    kind = getattr(getattr(param, "type_descriptor", None), "annotation", None)
    return param.param_type_name == "option" and kind is Path and not param.multiple


def _argument(param: Any) -> str:
    word: str = param.metavar or param.name.upper()
    return word if param.nargs == 1 or "..." in word else f"{word}..."


def _names(param: Any) -> str:
    """What is typed for an argument or option."""
    if param.param_type_name == "argument":
        return _argument(param)
    names = ", ".join(sorted(param.opts, key=len))
    if param.secondary_opts:
        names += " / " + ", ".join(param.secondary_opts)
    return f"{names} {param.metavar}" if param.metavar and not param.is_flag else names


def _lines(example: str, formatter: Any) -> Iterator[str]:
    """An example that can be copied, in lines that fit; they break before options."""
    indent = " " * formatter.current_indent
    line, *options = re.split(r" (?=--)", example)
    for option in options:
        if len(indent) + len(line) + len(option) + 3 > formatter.width:
            yield f"{indent}{line} \\\n"
            line = f"  {option}"
        else:
            line += f" {option}"
    yield f"{indent}{line}\n"


def _group(param: Any) -> str:
    if param.param_type_name == "argument":
        return "Arguments"
    if "--help" in param.opts:
        return GENERAL
    return getattr(param, "rich_help_panel", None) or "Options"


def _words(param: Any, ctx: Any) -> str:
    """What an argument or option means, with its limits and default."""
    notes = [*_limits(param), *_default(param, ctx)]
    if param.required and param.param_type_name == "option":
        notes.append("required")
    text = (param.help or "").rstrip()
    return f"{text} [{'; '.join(notes)}]" if notes else text


def _limits(param: Any) -> Iterator[str]:
    least, most = getattr(param, "min", None), getattr(param, "max", None)
    if least is not None:
        yield f"at least {least:g}" if most is None else f"{least:g} to {most:g}"


def _default(param: Any, ctx: Any) -> Iterator[str]:
    shown = getattr(param, "show_default", False)
    if isinstance(shown, str):
        yield f"default: {shown}"
        return
    value = param.get_default(ctx, call=False)
    if not shown or param.required or value in (None, False, (), []):
        return
    if param.param_type_name == "option" and param.is_flag and value is True:
        yield f"default: {param.opts[-1]}"
    else:
        yield f"default: {value:g}" if isinstance(value, float) else f"default: {value}"


def _write(formatter: Any, groups: dict[str, list[tuple[str, str]]]) -> None:
    """Write groups of names and words, with the words of all groups in one column."""
    lengths = [len(name) for rows in groups.values() for name, _ in rows]
    columns = max((each for each in lengths if each <= _NAME_COLUMNS), default=0)
    for heading, rows in groups.items():
        padded = [(_styled(f"{name:{columns}}"), words) for name, words in rows]
        if rows:
            with formatter.section(_heading(heading)):
                formatter.write_dl(padded, col_max=columns)


def _is_styled() -> bool:
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ


def _style(text: str, **style: Any) -> str:
    return typer.style(text, **style) if _is_styled() else text


_heading = partial(_style, bold=True)
_styled = partial(_style, fg="cyan")
