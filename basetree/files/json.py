"""Read and write JSON: texts without repeated keys, files of one schema, and dataclasses."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, NoReturn, TypeVar

from basetree.errors import InputError
from basetree.files.limits import current_limits

_T = TypeVar("_T")

_LONGEST_WHOLE: Final = 20  # characters of a whole number of 64 bits with its sign
_LONGEST_SHOWN: Final = 60
_WORDS: Final = {
    "str": "text",
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "object": "an object",
    "array": "a list",
    "null": "null",
}
_BOUNDS: Final = {">=": "of at least", "<=": "of at most", ">": "above", "<": "below", None: "of"}
_EXPECTED: Final = re.compile(
    r"Expected `(?P<kinds>[^`]+)`( of (?P<items>length))?( ?(?P<bound>[<>]=?))?"
    r"( (?P<number>-?[\d.e+-]+))?(?P<more> matching regex '.*')?(, got `?(?P<found>\w+)`?)?"
)
_MISSING: Final = re.compile(r"Object missing required field `([^`]+)`")
_STEP: Final = re.compile(r"\.(\w+)|\[(\d+)\]|(\[\.\.\.\])")
_NOT_KNOWN: Final = object()


def refuse_repeated(names: Iterable[str]) -> None:
    """Raise ValueError if a name is repeated."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ValueError(f"{name} is given twice")
        seen.add(name)


def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a JSON object of its pairs; ValueError if a key is repeated."""
    found = dict(pairs)
    if len(found) != len(pairs):
        refuse_repeated(name for name, _ in pairs)
    return found


def parse_json(text: str) -> Any:
    """Parse a JSON text: no key is repeated, numbers fit 64 bits, `Limits.text_nesting` holds.

    Raises:
        ValueError: If it is another text.
    """
    try:
        value = json.loads(
            text,
            object_pairs_hook=unique_keys,
            parse_constant=_refuse_constant,
            parse_float=_number,
            parse_int=_whole_number,
        )
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    _check_nesting(value)
    return value


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _number(text: str) -> float:
    if math.isfinite(value := float(text)):
        return value
    raise ValueError(f"{text:.{_LONGEST_WHOLE}} is not a number of 64 bits")


def _whole_number(text: str) -> int:
    if len(text) <= _LONGEST_WHOLE and -(2**63) <= (value := int(text)) < 2**64:
        return value
    raise ValueError(f"{text:.{_LONGEST_WHOLE}}... is not a number of 64 bits")


def _check_nesting(value: Any) -> None:
    deepest, level = current_limits().text_nesting, [value]
    for _ in range(deepest):
        level = [
            inner
            for outer in level
            if isinstance(outer, dict | list)
            for inner in (outer.values() if isinstance(outer, dict) else outer)
        ]
        if not level:
            return
    raise ValueError(f"it is nested more than {deepest} levels deep")


def read_json(
    path: Path, schema: str, kind: type[_T], expected: str, *, largest_bytes: int | None = None
) -> _T:
    """Read a file with one JSON object of this project.

    Args:
        path: The file.
        schema: Value of its field "schema".
        kind: What is made of it, see `build`.
        expected: What the file should be, for messages.
        largest_bytes: Size of the largest file; `Limits.text_file_bytes` if None.

    Raises:
        InputError: If the file cannot be read, is not JSON, has another schema, or a field is
            missing or has another type.
    """
    from basetree.files.reading import read_text

    expected = f"expected {expected}, schema {schema}"
    try:
        values = parse_json(read_text(path, expected.removeprefix("expected "), largest_bytes))
    except ValueError as error:
        raise InputError(f"{path} cannot be read, it is not JSON ({error}): {expected}") from error
    found = values.get("schema") if isinstance(values, dict) else type(values).__name__
    if found != schema:
        raise InputError(f"{path} has the schema {found!r:.60}: {expected}")
    return build(kind, values, str(path))


def json_text(schema: str, values: Mapping[str, Any]) -> str:
    """The text of a file of this project: a JSON object with its schema first."""
    return json.dumps({"schema": schema, **values}, indent=1) + "\n"


def build(kind: type[_T], data: object, where: str) -> _T:
    """Make an instance of a dataclass, or of another type, from a decoded JSON value.

    Lists become tuples, and objects become the dataclasses in the annotations, whose limits
    (`msgspec.Meta`) are checked. Unknown fields are ignored, so that newer versions may add fields.

    Args:
        kind: The type.
        data: The value.
        where: Name of the value in messages.

    Raises:
        InputError: If a field is missing, or has another type or a value out of its limits.
    """
    import msgspec

    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        raise InputError(_explained(str(error), data, where)) from error
    except UnicodeEncodeError as error:
        raise InputError(f"{where}: a field's name is not text ({error.reason})") from error
    except InputError as error:  # of the dataclass itself
        if where in str(error):
            raise
        raise InputError(f"{where}: {error}") from error


def decode(kind: type[_T], content: bytes, where: str) -> _T:
    """Make an instance of a dataclass from a large JSON text of which it holds a small part.

    Fields that the dataclass does not have are skipped without taking memory. Of keys that are
    repeated, the last one counts.

    Args:
        kind: The dataclass.
        content: The text, in UTF-8.
        where: Name of the text in messages.

    Raises:
        InputError: If it is not JSON, or as for `build`.
    """
    import msgspec

    try:
        return msgspec.json.decode(content, type=kind)
    except msgspec.ValidationError as error:
        raise InputError(_explained(str(error), _NOT_KNOWN, where)) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{where} is not JSON ({error})") from error


def _explained(message: str, data: object, where: str) -> str:
    """The project's words for a message of msgspec: the place, what was found and expected."""
    problem, _, place = message.partition(" - at `$")
    place = place.rstrip("`")
    subject = f"{where}: {place.lstrip('.')}" if place else where
    if missing := _MISSING.fullmatch(problem):
        return f"{subject} has no field {missing[1]!r}, expected it"
    found = _shown(_value_at(data, place))
    words = _EXPECTED.fullmatch(problem)
    if problem.startswith("Number out of range"):
        expected = "a number of 64 bits"
    elif words:
        expected = _expected(words)
        found = found or _WORDS.get(words["found"], "")
    else:
        return f"{subject}: {problem}"
    return (
        f"{subject} is {found}, expected {expected}" if found else f"{subject}: expected {expected}"
    )


def _expected(words: re.Match[str]) -> str:
    """What msgspec expected, in the project's words."""
    expected = " or ".join(_WORDS.get(kind, kind) for kind in words["kinds"].split(" | "))
    if words["number"]:
        expected += f" {_BOUNDS[words['bound']]} {words['number'].removesuffix('.0')}"
        expected += " items" * bool(words["items"])
    return expected + (words["more"] or "")


def _value_at(data: Any, place: str) -> object:
    """The value at a place such as ".frames[0].file"; `_NOT_KNOWN` inside of "[...]"."""
    for name, index, anywhere in _STEP.findall(place):
        if anywhere or data is _NOT_KNOWN:
            return _NOT_KNOWN
        data = data[name] if name else data[int(index)]
    return data


def _shown(value: object) -> str:
    """A value in a message; empty if it is not known."""
    if value is _NOT_KNOWN:
        return ""
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)} items"
    if value is None or isinstance(value, bool):
        return json.dumps(value)
    return f"{value!r:.{_LONGEST_SHOWN}}"
