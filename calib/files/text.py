"""Parse a text file as JSON, XML, INI or YAML, recognised by its content.

Every camera, transform and depth scale file is read here, within `basetree.files.Limits`.
"""

from __future__ import annotations

import configparser
import io
import json
import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from basetree.errors import InputFileError
from basetree.files.json import unique_keys
from basetree.files.limits import current_limits
from basetree.files.reading import read_text

_INI = re.compile(r"(\s*[;#].*\n)*\s*\[[A-Za-z]\w*\]\s*\n")
_OLD_OPENCV_HEADER = re.compile(r"\s*%YAML:1\.0[^\n]*\n")
_NO_SPACE_AFTER_KEY = re.compile(r"^([ \t]*[A-Za-z_][\w.]*:)(?=[\d\[\"-])", re.MULTILINE)


def parse(path: Path, text: str, expected: str) -> Any:
    """Parse JSON, XML, INI or YAML; a YAML file of several documents becomes a list.

    Args:
        path: The file, for messages.
        text: Its content.
        expected: What the file should be, for messages.

    Raises:
        InputFileError: If the text cannot be parsed, or has more values or levels than allowed.
    """
    start = text.lstrip()[:1]
    kind: str = "YAML"
    parser: Callable[[str], Any] = _parse_yaml
    if _INI.match(text):
        kind, parser = "INI", _parse_ini
    elif start in ("{", "["):
        kind, parser = "JSON", partial(json.loads, object_pairs_hook=unique_keys)
    elif start == "<":
        kind, parser = "XML", _parse_xml
    try:
        values = parser(text)
        _check_extent(values)
        return values
    except (ValueError, RecursionError, ElementTree.ParseError, configparser.Error) as error:
        reason = " ".join(str(error).split())
        raise InputFileError(f"{path}: not {kind} ({reason}), expected {expected}") from error


def parse_record(path: Path, schema: str, expected: str) -> Mapping[str, Any]:
    """Read a file of this project's own format.

    Args:
        path: The file.
        schema: Value of its field `schema`.
        expected: What the file should be, for the message.

    Raises:
        InputFileError: If the file is missing, unreadable or has another schema.
    """
    values = parse(path, read_text(path, expected), expected)
    found = values.get("schema") if isinstance(values, Mapping) else type(values).__name__
    if not isinstance(values, Mapping) or found != schema:
        raise InputFileError(f"{path}: schema is {found!r}, expected {schema!r}")
    return values


def _check_extent(values: Any) -> None:
    """Check the number of values and their nesting.

    Raises:
        ValueError: If there are more than allowed.
    """
    limits = current_limits()
    level, count = [values], 0
    for _ in range(limits.text_nesting):
        count += len(level)
        if count > limits.text_values:
            raise ValueError(f"more than {limits.text_values} values")
        level = [inner for value in level for inner in _parts(value)]
        if not level:
            return
    raise ValueError(f"nested more than {limits.text_nesting} levels deep")


def _parts(value: Any) -> Iterable[Any]:
    if isinstance(value, Mapping):
        return value.values()
    return value if isinstance(value, list) else ()


def _parse_ini(text: str) -> dict[str, dict[str, str]]:
    """Return the sections of an INI file; field names are lower case."""
    parser = configparser.ConfigParser(interpolation=None, default_section="")
    parser.read_string(text)
    return {name: dict(parser[name]) for name in parser.sections()}


def _parse_xml(text: str) -> Any:
    """Parse XML of OpenCV's FileStorage; leaves stay strings."""
    if "<!DOCTYPE" in text:
        raise ValueError("it has a document type, expected none")
    deepest, level = current_limits().text_nesting, 0
    elements: list[ElementTree.Element] = []
    for event, element in ElementTree.iterparse(io.StringIO(text), events=("start", "end")):
        level += 1 if event == "start" else -1
        elements = elements or [element]
        if level > deepest:
            raise ValueError(f"nested more than {deepest} levels deep")

    def values(element: ElementTree.Element) -> Any:
        if not len(element):
            return (element.text or "").strip().strip('"')
        if element[0].tag == "_":  # the tag of list items
            return [values(child) for child in element]
        return unique_keys([(child.tag, values(child)) for child in element])

    return values(elements[0])


def _parse_yaml(text: str) -> Any:
    """Parse YAML, including OpenCV's matrices, which become maps.

    Several documents become a list. OpenCV's old YAML needs no space between a key and its value.
    """
    from calib.files.yaml_text import parse_yaml

    if _OLD_OPENCV_HEADER.match(text):
        text = _NO_SPACE_AFTER_KEY.sub(r"\1 ", _OLD_OPENCV_HEADER.sub("", text, count=1))
    documents = parse_yaml(text)
    return documents if len(documents) > 1 else next(iter(documents), None)
