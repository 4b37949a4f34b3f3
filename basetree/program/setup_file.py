"""Files that hold the options of a command, in TOML.

A key is the long name of an option without its dashes, and SOURCE is `source`. What keys there are,
their types and limits come from the command's function, so that nothing is written twice.
"""

from __future__ import annotations

import difflib
import inspect
import json
import re
import textwrap
import tomllib
import types
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Final, Union, get_args, get_origin

import typer

from basetree.errors import InputError, InputFileError
from basetree.secrets import HIDDEN, hide_secrets, is_secret

_EXPECTED: Final = "a set-up file in TOML"
_LARGEST_BYTES: Final = 65_536
_META: Final = "basetree.setup_file"
_WIDTH: Final = 96
_WORDS: Final = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


@dataclass(frozen=True)
class NoPath:
    """Metadata of a parameter whose text is a path, unless it is one of some words.

    Attributes:
        holds: Whether a text is one of the words.
    """

    holds: Callable[[str], bool]


@dataclass(frozen=True)
class Key:
    """A key of a set-up file.

    Attributes:
        name: As it is written.
        parameter: Name of the function's parameter.
        kind: bool, int, float, str or Path.
        is_list: Whether the value is a list.
        default: What applies without it; None for nothing, `inspect.Parameter.empty` if needed.
        info: What typer knows of the option.
        no_path: Texts that are no paths, of an option whose others are.
    """

    name: str
    parameter: str
    kind: type
    is_list: bool
    default: Any
    info: Any
    no_path: NoPath | None = None

    def fault(self, value: Any) -> str | None:
        """What is expected instead of a value; None if it fits."""
        if self.is_list:
            texts = isinstance(value, list) and all(isinstance(each, str) for each in value)
            return None if texts else "a list of texts"
        allowed = {float: (int, float), Path: (str,), str: (str, int, float)}.get(
            self.kind, (self.kind,)
        )
        if not isinstance(value, allowed) or (isinstance(value, bool) and self.kind is not bool):
            return "a path, as a text" if self.kind is Path else _WORDS[self.kind]
        least, most = getattr(self.info, "min", None), getattr(self.info, "max", None)
        if self.kind in (int, float):
            if most is not None and not value <= most:
                return f"{least:g} to {most:g}" if least is not None else f"at most {most:g}"
            if least is not None and not value >= least:
                return f"{least:g} to {most:g}" if most is not None else f"at least {least:g}"
        return None

    def found(self, value: Any, folder: Path) -> Any:
        """The value as it would be typed; relative paths begin at the folder of the file."""
        if self.kind is Path:
            return str(folder / value)
        if self.kind is str and not self.is_list:
            text = str(value)
            names_file = "FILE" in (self.info.metavar or "") and (folder / text).is_file()
            is_path = self.no_path is not None and not self.no_path.holds(text)
            if names_file or (is_path and (folder / text).exists()):
                return str(folder / text)
            return text
        return value


@dataclass(frozen=True)
class SetupFile:
    """A set-up file that was read.

    Attributes:
        path: The file.
        values: The values by parameter, as they would be typed.
        lines: The line of each key, from 1 on.
        names: The key of each parameter that is given.
    """

    path: Path
    values: Mapping[str, Any]
    lines: Mapping[str, int]
    names: Mapping[str, str]

    def line_of(self, message: str) -> int | None:
        """The line that a message is about: that of the first option that it names."""
        places = {
            found.start(): line
            for name, line in self.lines.items()
            if (found := re.search(rf"--{re.escape(name)}(?![\w-])", message))
        }
        if places:
            return places[min(places)]
        quoted = {
            self.names[parameter]: value
            for parameter, value in self.values.items()
            if isinstance(value, str)
            and len(value) > 1
            and re.search(rf"(?<![\w-]){re.escape(hide_secrets(value))}(?![\w-])", message)
        }
        longest = max(quoted.values(), key=len, default=None)
        named = [self.lines.get(name) for name, value in quoted.items() if value == longest]
        return named[0] if len(named) == 1 else None


def setup_keys(command: Callable[..., Any]) -> dict[str, Key]:
    """The keys that a set-up file of a command may have, by their names."""
    found = (_key(each) for each in inspect.signature(command, eval_str=True).parameters.values())
    return {key.name: key for key in found if key is not None}


def read_setup(path: Path, command: Callable[..., Any]) -> SetupFile:
    """Read a set-up file.

    Raises:
        InputFileError: It cannot be read, is no TOML, or has an unknown key or a wrong value; the
            message names the line.
    """
    from basetree.files.reading import read_text

    text, keys = read_text(path, _EXPECTED, _LARGEST_BYTES), setup_keys(command)
    try:
        given = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        where = re.search(
            r"(?P<reason>.*) \(at (line (?P<line>\d+), column \d+|end .*)\)", str(error)
        )
        number = (where["line"] if where else None) or text.rstrip("\n").count("\n") + 1
        reason, line = where["reason"] if where else str(error), f" line {number}"
        raise InputFileError(f"{path}{line}: {reason}, expected {_EXPECTED}") from error
    except (RecursionError, ValueError) as error:  # nested too deeply, or a number without end
        raise InputFileError(f"{path}: cannot be read, expected {_EXPECTED}") from error
    lines, values = _lines(text, given), {}
    for name, value in given.items():
        place = f"{path} line {lines[name]}" if name in lines else str(path)
        if name not in keys:
            raise InputFileError(f"{place}: {name} is no setting: expected {_like(name, keys)}")
        expected = keys[name].fault(value)
        if expected is not None:
            raise InputFileError(f"{place}: {name} is {_shown(name, value)}: expected {expected}")
        values[keys[name].parameter] = keys[name].found(value, path.absolute().parent)
    return SetupFile(path, values, lines, {keys[name].parameter: name for name in given})


def take_setup(context: typer.Context, path: Path | None, command: Callable[..., Any]) -> None:
    """Let a set-up file give the options that were not typed.

    Args:
        context: The context of the command, before its other options are parsed.
        path: The file; None for none.
        command: The function of the command.
    """
    if path is not None:
        setup = read_setup(path, command)
        context.default_map = dict(setup.values)
        context.meta[_META] = setup


def naming_lines(command: Callable[..., None]) -> Callable[..., None]:
    """Let the errors of a command that has a `context` name the line of the set-up file."""

    @wraps(command)
    def located(**values: Any) -> None:
        with lines_named(values["context"].meta.get(_META)):
            command(**values)

    return located


@contextmanager
def lines_named(setup: SetupFile | None) -> Iterator[None]:
    """Let errors in the block name the line of a set-up file that they are about."""
    try:
        yield
    except InputError as error:
        line = None if setup is None else setup.line_of(str(error))
        if setup is not None and line is not None:
            error.args = (f"{setup.path} line {line}: {error}", *error.args[1:])
        raise


def setup_text(command: Callable[..., Any], setup: SetupFile | None) -> str:
    """A set-up file with every key: those that are given, and the others as comments.

    Values with secrets are comments, too, and not shown.

    Args:
        command: The function of the command.
        setup: What is given; None for nothing.
    """
    given = {} if setup is None else setup.values
    parts = []
    for key in setup_keys(command).values():
        words = " ".join((key.info.help or "").split())
        about = textwrap.wrap(words, _WIDTH, initial_indent="# ", subsequent_indent="# ")
        is_given = key.parameter in given
        value = given[key.parameter] if is_given else key.default
        shown = '""' if value in (None, inspect.Parameter.empty) else _toml(key, value)
        if is_given and (is_secret(key.name) or hide_secrets(str(value)) != str(value)):
            is_given, shown = False, f'"{HIDDEN}"  (it is given, and not shown)'
        parts.append("\n".join([*about, f"{'' if is_given else '# '}{key.name} = {shown}"]))
    return "\n\n".join(parts) + "\n"


def _key(parameter: inspect.Parameter) -> Key | None:
    hint = parameter.annotation
    if get_origin(hint) is not Annotated:
        return None
    kind, info, *others = get_args(hint)
    if getattr(info, "is_eager", False):
        return None
    if get_origin(kind) in (Union, types.UnionType):
        (kind,) = (each for each in get_args(kind) if each is not types.NoneType)
    is_list = get_origin(kind) is list
    given = (info.default, *(info.param_decls or ()))  # typer takes the first name for a default
    names = [name for name in given if isinstance(name, str) and name.startswith("--")]
    name = names[0].partition("/")[0].removeprefix("--") if names else parameter.name
    return Key(
        name.replace("_", "-"),
        parameter.name,
        str if is_list else kind,
        is_list,
        parameter.default,
        info,
        next((each for each in others if isinstance(each, NoPath)), None),
    )


def _lines(text: str, given: Mapping[str, Any]) -> dict[str, int]:
    """The line of each key: the first from which on the text above has it no more."""
    lines = text.split("\n")
    found = {}
    for number, line in enumerate(lines, 1):
        matched = re.match(r"\s*\[*\s*[\"']?([\w.-]+?)[\"']?\s*(?:[=.\]])", line)
        name = matched[1].partition(".")[0] if matched else ""
        if name not in given or name in found:
            continue
        try:
            tomllib.loads("\n".join(lines[: number - 1]))
        except (tomllib.TOMLDecodeError, RecursionError, ValueError):
            continue  # inside a text or a list of several lines
        found[name] = number
    return found


def _like(name: str, keys: Mapping[str, Key]) -> str:
    near = difflib.get_close_matches(name.replace("_", "-"), keys, 1)
    return near[0] if near else "the name of an option without its dashes, such as camera"


def _shown(name: str, value: Any) -> str:
    if is_secret(name):
        return "not shown"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value)


def _toml(key: Key, value: Any) -> str:
    if key.is_list:
        return "[" + ", ".join(json.dumps(each, ensure_ascii=False) for each in value) + "]"
    if key.kind in (str, Path):
        return json.dumps(str(value), ensure_ascii=False)
    return str(value).lower() if key.kind is bool else repr(value)
