"""Accept or refuse a model file by its signature, and give its content.

The content that was hashed is the content that is opened: the file is read once.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from basetree.files.regular import open_regular
from edgetree.errors import SignatureError
from edgetree.signing.envelope import Envelope, parse_envelope
from edgetree.signing.json_files import read_small_text
from edgetree.signing.keys import is_signed_by
from edgetree.signing.statement import Statement, parse_statement, parse_time, time_text
from edgetree.signing.trust import Trust, TrustedKey, current_trust
from edgetree.signing.used_versions import (
    check_version,
    read_used,
    record_time,
    record_use,
    used_file,
)

_PACKAGED: Final = Path(os.path.realpath(__file__)).parents[1] / "assets" / "models"
_EXPECTED: Final = "a signature of `edgetree sign`"

_required_in_process = False


def require_signatures() -> None:
    """Refuse models without an accepted signature in this process, whatever the machine's setting.

    The packaged models are part of the installed package and need no signature.
    """
    global _required_in_process
    _required_in_process = True


def is_signature_required() -> bool:
    """Whether models need a signature, in this process or for this account.

    Raises:
        SignatureError: a trust file cannot be read, or is not one.
    """
    return _required_in_process or current_trust().required_by is not None


@dataclass(frozen=True)
class AcceptedModel:
    """A model that may be opened.

    Attributes:
        path: The model file.
        content: The content of the file.
        statement: What its signer says; None for a packaged model.
        key: The signer's key, likewise.
        checked_at: The time by the clock, likewise.
    """

    path: Path
    content: bytes
    statement: Statement | None = None
    key: TrustedKey | None = None
    checked_at: datetime | None = None

    def record_use(self) -> None:
        """Record the version of the model, so that older ones are refused from now on.

        Raises:
            SignatureError: a new version cannot be recorded, or a higher one was used meanwhile.
        """
        if self.statement is not None and self.checked_at is not None:
            record_use(self.statement, self.path, used_file(), self.checked_at)


def signature_file(model: Path) -> Path:
    """The file of a model's signature: beside the file that a link leads to, with .sig added."""
    return Path(f"{os.path.realpath(model)}.sig")


def model_if_signed(path: Path, required: bool = False) -> AcceptedModel | None:
    """Check the signature of a model file, if one is required.

    Args:
        path: The model file, which exists.
        required: Require a signature, whatever the setting of the machine.

    Returns:
        The accepted model; None if the file can be opened by its path, as no signature is required.

    Raises:
        SignatureError: The signature is missing or not accepted, or a trust file is broken.
        MissingPackage: `cryptography` is not installed.
    """
    real = Path(os.path.realpath(path))
    if real.parent == _PACKAGED:
        # Another path may lead elsewhere by the time it is opened.
        return None if path.absolute() == real else AcceptedModel(path, _read(path, None))
    trust = current_trust()
    if required or _required_in_process or trust.required_by is not None:
        return check_signature(path, trust)
    return None


def check_signature(path: Path, trust: Trust) -> AcceptedModel:
    """Check the signature of a model file.

    Args:
        path: The model file, which exists.
        trust: The trusted keys.

    Raises:
        SignatureError: The signature is missing or not accepted.
        MissingPackage: `cryptography` is not installed.
    """
    now = _now()
    file = signature_file(path)
    if not os.path.lexists(file):
        why = "" if trust.required_by is None else f", required by {trust.required_by}"
        raise SignatureError(f"model {path} has no signature {file}{why}: expected {_EXPECTED}")
    try:
        envelope = parse_envelope(read_small_text(file, _EXPECTED))
        key = _signer(envelope, trust)
        statement = parse_statement(envelope.payload)
    except SignatureError as error:
        raise SignatureError(f"signature {file} is not accepted: {error}") from error
    state = used_file()
    used = read_used(state)
    clock = f"the clock says {time_text(now)}"
    latest = used.latest(now)
    if latest > now:
        clock += f", and it said {time_text(latest)} before (see {state})"
    try:
        _check_time(statement, key, file, latest, clock)
    except SignatureError:
        record_time(state, now)  # so that no clock that is set back makes it valid again
        raise
    content = _read(path, statement)
    check_version(statement, path, used, state)
    return AcceptedModel(path, content, statement, key, now)


def parse_signature(content: bytes) -> Statement:
    """Parse the content of a signature file, without checking the signature.

    Raises:
        SignatureError: It is not the content of a signature file.
    """
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        raise SignatureError("the signature is not a text in UTF-8") from error
    return parse_statement(parse_envelope(text).payload)


def _now() -> datetime:
    return datetime.now(UTC)


def _signer(envelope: Envelope, trust: Trust) -> TrustedKey:
    """The trusted key that signed the envelope."""
    key = trust.keys.get(envelope.key_id)
    if key is None:
        known = ", ".join(f"{key.id} ({key.name})" for key in trust.keys.values()) or "no key"
        raise SignatureError(
            f"its key {envelope.key_id[:100]!r} is not trusted: expected a key of"
            f" {' or '.join(map(str, trust.files))}, which trust {known}"
        )
    if not is_signed_by(key.public_bytes, envelope.signature, envelope.message):
        raise SignatureError(
            f"it was changed, or is not by the key {key.id} ({key.name}) that it names"
        )
    return key


def _check_time(
    statement: Statement, key: TrustedKey, file: Path, now: datetime, clock: str
) -> None:
    """Check the validity of signature and key; `clock` says what the time is, for messages."""
    if now < parse_time(statement.valid_from):
        raise SignatureError(
            f"signature {file} is valid from {statement.valid_from}, and {clock}: expected a"
            " correct clock, or another signature"
        )
    ends = {
        f"signature {file}": statement.valid_until,
        f"key {key.id} ({key.name})": key.valid_until,
    }
    for what, end in ends.items():
        if end is not None and now > parse_time(end):
            raise SignatureError(
                f"{what} was valid until {end}, and {clock}: expected a new signature of"
                f" {file.with_suffix('')} by a valid key"
            )


def _read(path: Path, statement: Statement | None) -> bytes:
    """The content of a file; of a signed one, only if it is the content that was signed."""
    real = Path(os.path.realpath(path))
    try:
        with open_regular(real) as stream:
            content = stream.read() if statement is None else stream.read(statement.file_bytes + 1)
    except OSError as error:
        raise SignatureError(
            f"model {path} cannot be read ({error.strerror}): expected a readable .onnx file"
        ) from error
    if statement is not None and hashlib.sha256(content).hexdigest() != statement.file_sha256:
        raise SignatureError(
            f"model {path} is not the file that {signature_file(path)} was made for"
            f" ({statement.name!r}, version {statement.version}): it was changed, or is another"
            " file; expected the signed file"
        )
    return content
