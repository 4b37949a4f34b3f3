"""Signature files: a DSSE envelope in JSON, which holds what was signed and one signature.

The Dead Simple Signing Envelope is described at https://github.com/secure-systems-lab/dsse. The
payload is kept as the bytes that were signed, so that no canonical form of JSON is needed.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from typing import Final

from edgetree.errors import SignatureError
from edgetree.signing.json_files import parse_record

PAYLOAD_TYPE: Final = "application/vnd.edgetree.model-signature+json"


@dataclass(frozen=True)
class Envelope:
    """A payload and its signature.

    Attributes:
        payload: The JSON text of a `Statement`.
        key_id: id of the signer's key. It is not signed, and only says which key to try.
        signature: The signature of `message`.
    """

    payload: bytes
    key_id: str
    signature: bytes

    @property
    def message(self) -> bytes:
        """The bytes that the signature is made of: DSSE's pre-authentication encoding."""
        return message_of(self.payload)

    def to_json(self) -> str:
        """The content of a signature file."""
        payload, signature = base64.b64encode(self.payload), base64.b64encode(self.signature)
        entry = {"keyid": self.key_id, "sig": signature.decode()}
        envelope = {"payloadType": PAYLOAD_TYPE, "payload": payload.decode(), "signatures": [entry]}
        return json.dumps(envelope, indent=1) + "\n"


def message_of(payload: bytes) -> bytes:
    """The bytes to sign for a payload."""
    kind = PAYLOAD_TYPE.encode()
    return b"DSSEv1 %d %s %d %s" % (len(kind), kind, len(payload), payload)


@dataclass(frozen=True)
class _Entry:
    keyid: str
    sig: str


@dataclass(frozen=True)
class _File:
    payloadType: str
    payload: str
    signatures: tuple[_Entry, ...]


def parse_envelope(text: str) -> Envelope:
    """Parse the content of a signature file.

    Raises:
        SignatureError: It is not such a content.
    """
    file = parse_record(_File, text, "the envelope")
    if file.payloadType != PAYLOAD_TYPE:
        raise SignatureError(
            f"the envelope's payloadType is {file.payloadType[:100]!r}: expected {PAYLOAD_TYPE!r}"
        )
    if len(file.signatures) != 1:
        raise SignatureError(f"it has {len(file.signatures)} signatures: expected one")
    entry = file.signatures[0]
    try:
        payload = base64.b64decode(file.payload, validate=True)
        return Envelope(payload, entry.keyid, base64.b64decode(entry.sig, validate=True))
    except ValueError as error:
        raise SignatureError(f"its content is not base64 ({error})") from error
