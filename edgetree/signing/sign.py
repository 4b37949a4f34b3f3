"""Sign a model file."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from basetree.errors import InputError, InputFileError
from basetree.files.regular import read_regular
from basetree.files.writing import write_text
from edgetree.errors import ModelFileError
from edgetree.model_file.manifest import METADATA_KEY, Manifest
from edgetree.model_file.safety_check import check_content, check_is_file
from edgetree.signing.envelope import Envelope, message_of
from edgetree.signing.keys import key_id, public_bytes
from edgetree.signing.statement import Statement, time_text, version_of
from edgetree.signing.verify import signature_file

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey


def sign_model(
    path: Path,
    key: Ed25519PrivateKey,
    *,
    version: int | None = None,
    name: str | None = None,
    valid_until: str | None = None,
) -> tuple[Path, Statement]:
    """Sign a model file. An older signature of it is replaced.

    Args:
        path: a file of `edgetree export`. It passes the safety check, or is not signed.
        key: The private key.
        version: Version of the model; by default the time in UTC, such as 20261123080000.
        name: Name of the model, whose versions rise; by default the name in its manifest.
        valid_until: Last second of the validity, as of `end_of_day`; None for no end.

    Returns:
        The signature file, and what was signed.

    Raises:
        ModelFileError: The file is not a model of this project, or a value is out of range.
        InputError: The signature cannot be written.
    """
    check_is_file(path)
    try:
        content = read_regular(path)
    except OSError as error:
        raise ModelFileError(f"model {path} cannot be read ({error.strerror})") from error
    metadata = check_content(content, path).metadata
    if METADATA_KEY not in metadata:
        raise ModelFileError(f"model {path} has no manifest: expected a file of `edgetree export`")
    manifest = Manifest.from_json(metadata[METADATA_KEY])
    now = datetime.now(UTC)
    statement = Statement(
        name=manifest.name if name is None else name,
        version=version_of(now) if version is None else version,
        file_bytes=len(content),
        file_sha256=hashlib.sha256(content).hexdigest(),
        valid_from=time_text(now),
        valid_until=valid_until,
    )
    payload = statement.to_json().encode()
    envelope = Envelope(payload, key_id(public_bytes(key)), key.sign(message_of(payload)))
    file = signature_file(path)
    try:
        write_text(file, envelope.to_json())
    except InputFileError as error:
        raise InputError(str(error)) from error
    return file, statement
