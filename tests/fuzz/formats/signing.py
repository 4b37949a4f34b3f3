"""Signatures, keys and files of trusted keys."""

from __future__ import annotations

import tempfile
from pathlib import Path

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from edgetree.signing import (
    Statement,
    TrustedKey,
    TrustFile,
    parse_signature,
    read_private_key,
    read_public_key,
)
from edgetree.signing.envelope import Envelope
from edgetree.signing.trust import read_trust_file, write_trust_file
from edgetree.signing.used_versions import read_used
from formats.form import Format


def _signature() -> bytes:
    statement = Statement("small", 3, 100, "0" * 64, "2026-11-23T08:00:00Z", "2027-12-31T23:59:59Z")
    return Envelope(statement.to_json().encode(), "0" * 64, bytes(64)).to_json().encode()


def _public_key_and_trust() -> tuple[bytes, bytes]:
    key = Ed25519PrivateKey.from_private_bytes(bytes(32)).public_key()
    form = serialization.PublicFormat.SubjectPublicKeyInfo
    pem = key.public_bytes(serialization.Encoding.PEM, form)
    entry = TrustedKey.of(key.public_bytes_raw(), "office", "2027-12-31T23:59:59Z")
    with tempfile.TemporaryDirectory() as name:
        trust = Path(name, "trust.json")
        write_trust_file(trust, TrustFile(True, (entry,)))
        return pem, trust.read_bytes()


def _private_key() -> bytes:
    key = Ed25519PrivateKey.from_private_bytes(bytes(32))
    encoding, form = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    return key.private_bytes(encoding, form, serialization.NoEncryption())


_USED = b"""{"schema": "edgetree.used-versions/1", "latest_time": "2026-11-23T08:00:00Z",
 "models": [{"name": "pine", "version": 3, "file_sha256": "00"}]}"""
_KEY, _TRUST = _public_key_and_trust()

FORMATS = {
    "signature": Format((_signature(),), lambda path: parse_signature(path.read_bytes())),
    "trust.json": Format((_TRUST,), read_trust_file),
    "key.pub": Format((_KEY,), read_public_key),
    "key.pem": Format((_private_key(),), lambda path: read_private_key(path, lambda: "")),
    "used.json": Format((_USED,), read_used),
}
