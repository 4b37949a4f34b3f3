"""Sign model files, and open only signed ones: Ed25519 signatures, checked without a network.

    key = read_private_key(Path("office.pem"), ask_passphrase=lambda: "")
    file, statement = sign_model(Path("model.onnx"), key, version=4)

What a signature says is a `Statement`. Whether signatures are required, and which keys are trusted,
is in the trust files of the machine and of the account (`current_trust`). Signing and checking need
the package `cryptography`.
"""

from edgetree.signing.keys import new_key, read_private_key, read_public_key
from edgetree.signing.sign import sign_model
from edgetree.signing.statement import Statement
from edgetree.signing.trust import Trust, TrustedKey, TrustFile, current_trust
from edgetree.signing.verify import (
    AcceptedModel,
    check_signature,
    parse_signature,
    require_signatures,
)

__all__ = [
    "AcceptedModel",
    "Statement",
    "Trust",
    "TrustFile",
    "TrustedKey",
    "check_signature",
    "current_trust",
    "new_key",
    "parse_signature",
    "read_private_key",
    "read_public_key",
    "require_signatures",
    "sign_model",
]
