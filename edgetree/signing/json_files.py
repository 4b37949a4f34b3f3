"""Read the small files of this package, within the limits of `basetree.files.Limits`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TypeVar

from basetree.errors import InputError, InputFileError
from basetree.files.json import build, parse_json
from basetree.files.reading import read_text
from edgetree.errors import SignatureError

_T = TypeVar("_T")


def read_small_text(path: Path, expected: str) -> str:
    """The text of a small file.

    Args:
        path: The file.
        expected: What it should be, for messages.

    Raises:
        SignatureError: It is missing, is no regular file, cannot be read, or is too large.
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


def read_record(kind: type[_T], path: Path, expected: str, schema: str, where: str) -> _T | None:
    """Read a file of this package, as `parse_record`; None if it does not exist.

    Raises:
        SignatureError: It cannot be read, or has another content.
    """
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise SignatureError(
            f"{where} cannot be read ({error.strerror}): expected {expected}"
        ) from error
    return parse_record(kind, read_small_text(path, expected), where, schema)


def parse_record(kind: type[_T], text: str, where: str, schema: str | None = None) -> _T:
    """Make an instance of a dataclass from the text of one JSON object.

    Args:
        kind: The dataclass.
        text: The JSON text, in which no key may be repeated.
        where: Name of the object in messages.
        schema: What the object's key "schema" must be; None for an object without one.

    Raises:
        SignatureError: It is not such a text, or a field is missing or out of range.
    """
    try:
        value = parse_json(text)
        found = value.get("schema") if isinstance(value, dict) else schema
        if found != schema:
            raise SignatureError(f"schema is {str(found)[:100]!r}: expected {schema!r}")
        return build(kind, value, where)
    except (ValueError, RecursionError) as error:
        raise SignatureError(f"{where} is not JSON ({error})") from error
    except SignatureError as error:
        raise SignatureError(f"{where}: {error}") from error
    except InputError as error:
        raise SignatureError(str(error)) from error
