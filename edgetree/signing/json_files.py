"""Read and write the small JSON files of this package, within the limits of `limits.Limits`."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from basetree.errors import InputFileError
from calib.files.text import read_text
from edgetree.errors import ModelFileError, SignatureError
from edgetree.model_file.json_fields import build

__all__ = ["json_text", "parse_json", "read_small_text"]

_T = TypeVar("_T")


def read_small_text(path: Path, expected: str) -> str:
    """The text of a small file.

    Args:
        path: the file.
        expected: what it should be, for messages.

    Raises:
        SignatureError: it is missing, is no regular file, cannot be read, or is too large.
    """
    try:
        if not path.is_file():
            what = "is not a regular file" if path.exists() else "does not exist"
            raise SignatureError(f"{path} {what}: expected {expected}")
        return read_text(path, expected)
    except OSError as error:
        raise SignatureError(
            f"{path} cannot be read ({error.strerror}): expected {expected}"
        ) from error
    except InputFileError as error:
        more = "" if "expected" in str(error) else f": expected {expected}"
        raise SignatureError(f"{error}{more}") from error


def json_text(value: Any, schema: str) -> str:
    """A dataclass as the text of a JSON object, with the version of its layout first."""
    return json.dumps({"schema": schema, **dataclasses.asdict(value)}, indent=1) + "\n"


def parse_json(kind: type[_T], text: str, where: str, schema: str | None = None) -> _T:
    """Make an instance of a dataclass from the text of one JSON object.

    Args:
        kind: the dataclass.
        text: the JSON text, in which no key may be repeated.
        where: name of the object in messages.
        schema: what the object's key "schema" must be; None for an object without one.

    Raises:
        SignatureError: it is not such a text, or a field is missing or out of range.
    """
    try:
        value = json.loads(text, object_pairs_hook=_unique, parse_constant=_refuse_constant)
        found = value.get("schema") if isinstance(value, dict) else schema
        if found != schema:
            raise SignatureError(f"schema is {str(found)[:100]!r}: expected {schema!r}")
        return build(kind, value, where)
    except (ValueError, RecursionError) as error:
        raise SignatureError(f"{where} is not JSON ({error})") from error
    except SignatureError as error:
        raise SignatureError(f"{where}: {error}") from error
    except ModelFileError as error:
        raise SignatureError(str(error)) from error


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key is repeated")
    return found


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")
