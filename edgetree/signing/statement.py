"""The statement that a signature is made of: which file, which version, how long it is valid."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from typing import Final

from basetree.errors import InputError
from basetree.files.json import json_text
from edgetree.errors import SignatureError
from edgetree.signing.json_files import parse_record

SCHEMA: Final = "edgetree.model-signature/1"
_LARGEST_VERSION: Final = 10**15  # exact in every reader of JSON
_LONGEST_NAME: Final = 200


@dataclass(frozen=True)
class Statement:
    """What the signer of a model file says about it.

    Attributes:
        name: Name of the model, whose versions rise.
        version: Version of the model; machines refuse lower ones than they have used.
        file_bytes: Size of the file.
        file_sha256: SHA-256 of the whole file, with its manifest, as 64 hexadecimal digits.
        valid_from: Time of signing, such as 2026-11-23T08:00:00Z.
        valid_until: Last second of the validity, likewise; None for no end.

    Raises:
        SignatureError: a value is out of range.
    """

    name: str
    version: int
    file_bytes: int
    file_sha256: str
    valid_from: str
    valid_until: str | None = None

    def __post_init__(self) -> None:
        named = self.name.strip() == self.name and self.name.isprintable()
        named = named and 0 < len(self.name) <= _LONGEST_NAME
        _require(named, "name", self.name, f"1 to {_LONGEST_NAME} characters")
        in_range = 1 <= self.version <= _LARGEST_VERSION
        _require(in_range, "version", self.version, f"1 to {_LARGEST_VERSION}")
        _require(self.file_bytes > 0, "file_bytes", self.file_bytes, "1 or more")
        is_hash = re.fullmatch("[0-9a-f]{64}", self.file_sha256) is not None
        _require(is_hash, "file_sha256", self.file_sha256, "64 hexadecimal digits")
        start = parse_time(self.valid_from)
        ordered = self.valid_until is None or parse_time(self.valid_until) > start
        _require(ordered, "valid_until", self.valid_until, f"a time after {self.valid_from}")

    def to_json(self) -> str:
        """The payload of a signature."""
        return json_text(SCHEMA, asdict(self))


def _require(condition: bool, what: str, value: object, expected: str) -> None:
    if not condition:
        raise SignatureError(f"{what} is {str(value)[:300]!r}: expected {expected}")


def parse_statement(payload: bytes) -> Statement:
    """Parse the payload of a signature.

    Raises:
        SignatureError: It is not JSON, or a field is missing or out of range.
    """
    where = "the signed statement"
    try:
        text = payload.decode()
    except UnicodeDecodeError as error:
        raise SignatureError(f"{where} is not a text in UTF-8") from error
    return parse_record(Statement, text, where, SCHEMA)


def time_text(time: datetime) -> str:
    """A time in UTC as text, such as 2026-11-23T08:00:00Z."""
    return time.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def parse_time(text: str) -> datetime:
    """Parse what `time_text` gives.

    Raises:
        SignatureError: It is another text.
    """
    try:
        return datetime.strptime(text, "%Y-%m-%dT%H:%M:%SZ").replace(tzinfo=UTC)
    except ValueError as error:
        raise SignatureError(
            f"the time is {text[:100]!r}: expected one such as '2026-11-23T08:00:00Z'"
        ) from error


def end_of_day(date: str) -> str:
    """The last second of a day in UTC as text, for a date such as 2027-12-31.

    Raises:
        InputError: It is no date.
    """
    try:
        day = datetime.strptime(date, "%Y-%m-%d").replace(tzinfo=UTC)
        return time_text(day + timedelta(days=1, seconds=-1))
    except (ValueError, OverflowError) as error:
        raise InputError(
            f"--valid-until is {date!r}: expected a date such as 2027-12-31"
        ) from error


def version_of(time: datetime) -> int:
    """The version of a model that is signed at a time: 20261123080000 for 2026-11-23 08:00:00."""
    return int(time.astimezone(UTC).strftime("%Y%m%d%H%M%S"))
