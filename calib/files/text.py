"""Parse a text file as JSON, XML, INI or YAML, recognised by its content."""

from __future__ import annotations

import configparser
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast
from xml.etree import ElementTree

from calib.errors import InputFileError

_INI = re.compile(r"(\s*[;#].*\n)*\s*\[[A-Za-z]\w*\]\s*\n")
_OLD_OPENCV_HEADER = re.compile(r"\s*%YAML:1\.0[^\n]*\n")
_NO_SPACE_AFTER_KEY = re.compile(r"^(\s*[A-Za-z_][\w.]*:)(?=[\d\[\"-])", re.MULTILINE)


def read_text(path: Path, expected: str) -> str:
    """Read a UTF-8 text file.

    Args:
        path: The file.
        expected: What the file should be, for messages.

    Raises:
        InputFileError: If the file is missing, unreadable or not text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise InputFileError(f"{path}: no such file, expected {expected}") from error
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputFileError(f"{path}: not a text file, expected {expected}") from error


def parse(path: Path, text: str, expected: str) -> Any:
    """Parse JSON, XML, INI or YAML; a YAML file of several documents becomes a list.

    Args:
        path: The file, for messages.
        text: Its content.
        expected: What the file should be, for messages.

    Raises:
        InputFileError: If the text cannot be parsed.
    """
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


def parse_record(path: Path, schema: str, expected: str) -> Mapping[str, Any]:
    """Read a file of this project's own format.

    Args:
        path: The file.
        schema: Value of its field ``schema``.
        expected: What the file should be, for the message.

    Raises:
        InputFileError: If the file is missing, unreadable or has another schema.
    """
    values = parse(path, read_text(path, expected), expected)
    found = values.get("schema") if isinstance(values, Mapping) else type(values).__name__
    if not isinstance(values, Mapping) or found != schema:
        raise InputFileError(f"{path}: schema is {found!r}, expected {schema!r}")
    return values


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the pairs as a dict; ValueError if a key is repeated."""
    values = dict(pairs)
    if len(values) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"{next(n for n in names if names.count(n) > 1)} is given twice")
    return values


def _parse_json(text: str) -> Any:
    return json.loads(text, object_pairs_hook=_unique)


def _parse_ini(text: str) -> dict[str, dict[str, str]]:
    """Return the sections of an INI file; field names are lower case."""
    parser = configparser.ConfigParser(interpolation=None)
    parser.read_string(text)
    return {name: dict(parser[name]) for name in parser.sections()}


def _parse_xml(text: str) -> Any:
    """Parse XML of OpenCV's FileStorage; leaves stay strings."""

    def values(element: ElementTree.Element) -> Any:
        if not len(element):
            return (element.text or "").strip().strip('"')
        if element[0].tag == "_":  # the tag of list items
            return [values(child) for child in element]
        return _unique([(child.tag, values(child)) for child in element])

    return values(ElementTree.fromstring(text))


def _parse_yaml(text: str) -> Any:
    """Parse YAML, including OpenCV's matrices, which become maps. Repeated keys are an error.

    Several documents become a list. OpenCV's old YAML needs no space between a key and its value.
    """
    import yaml

    class Loader(yaml.SafeLoader):
        """Rejects repeated keys."""

        def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
            """Check the keys, then do as the base class."""
            keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
            _unique([(key, None) for key in keys])
            return super().construct_mapping(node, deep)

    Loader.add_constructor(
        "tag:yaml.org,2002:opencv-matrix",
        lambda loader, node: loader.construct_mapping(cast("yaml.MappingNode", node), deep=True),
    )
    if _OLD_OPENCV_HEADER.match(text):
        text = _NO_SPACE_AFTER_KEY.sub(r"\1 ", _OLD_OPENCV_HEADER.sub("", text, count=1))
    try:
        documents = [item for item in yaml.load_all(text, Loader) if item is not None]
        return documents if len(documents) > 1 else next(iter(documents), None)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from error
