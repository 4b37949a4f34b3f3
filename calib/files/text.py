"""From a file's text to nested values, by what the text looks like."""

from __future__ import annotations

import configparser
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast
from xml.etree import ElementTree

from calib.errors import InputFileError

_INI = re.compile(r"(\s*[;#].*\n)*\s*\[[A-Za-z]\w*\]\s*\n")
_OLD_OPENCV_HEADER = re.compile(r"\s*%YAML:1\.0[^\n]*\n")


def read_text(path: Path, expected: str) -> str:
    """A file's text; raises InputFileError with what was expected there."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise InputFileError(f"{path}: no such file, expected {expected}") from error
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputFileError(f"{path}: not a text file, expected {expected}") from error


def parse(path: Path, text: str, expected: str) -> Any:
    """The values in JSON, XML, INI or YAML; raises InputFileError for a broken one."""
    start = text.lstrip()[:1]
    kind: str = "YAML"
    parser: Callable[[str], Any] = _parse_yaml
    if _INI.match(text):
        kind, parser = "INI", _parse_ini
    elif start in ("{", "["):
        kind, parser = "JSON", _parse_json
    elif start == "<":
        kind, parser = "XML", _parse_xml
    try:
        return parser(text)
    except (ValueError, RecursionError, ElementTree.ParseError, configparser.Error) as error:
        reason = " ".join(str(error).split())
        raise InputFileError(f"{path}: not {kind} ({reason}), expected {expected}") from error


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A map of what comes once."""
    values = dict(pairs)
    if len(values) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"{next(n for n in names if names.count(n) > 1)} is given twice")
    return values


def _parse_json(text: str) -> Any:
    return json.loads(text, object_pairs_hook=_once)


def _parse_ini(text: str) -> dict[str, dict[str, str]]:
    """Sections of an INI file, their fields in lower case."""
    parser = configparser.ConfigParser(interpolation=None)
    parser.read_string(text)
    return {name: dict(parser[name]) for name in parser.sections()}


def _parse_xml(text: str) -> Any:
    """What OpenCV's FileStorage wrote: elements by name, the text of leaves as it is."""

    def values(element: ElementTree.Element) -> Any:
        if not len(element):
            return (element.text or "").strip().strip('"')
        if element[0].tag == "_":  # the name of what is in a list
            return [values(child) for child in element]
        return _once([(child.tag, values(child)) for child in element])

    return values(ElementTree.fromstring(text))


def _parse_yaml(text: str) -> Any:
    """Plain YAML, and OpenCV's: its matrices become maps. A key that comes twice is an error."""
    import yaml

    class Loader(yaml.SafeLoader):
        """Strict about keys."""

        def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
            """As the base does, after a look at the keys."""
            keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
            _once([(key, None) for key in keys])
            return super().construct_mapping(node, deep)

    Loader.add_constructor(
        "tag:yaml.org,2002:opencv-matrix",
        lambda loader, node: loader.construct_mapping(cast("yaml.MappingNode", node), deep=True),
    )
    try:
        return yaml.load(_OLD_OPENCV_HEADER.sub("", text, count=1), Loader)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from error
