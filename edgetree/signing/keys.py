"""Ed25519 keys: make a pair, read its files, sign and check signatures.

A private key is a PEM file (PKCS #8), encrypted with a passphrase if wanted. A public key is a PEM
file (SubjectPublicKeyInfo). `cryptography` is imported on first use.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from basetree.errors import InputError, InputFileError, MissingPackage, install_hint
from basetree.files.writing import write_whole
from edgetree.signing.json_files import read_small_text

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

KEY_BYTES: Final = 32
_ID_DIGITS: Final = 16
_OWNER_ONLY: Final = 0o600


def ed25519() -> Any:
    """The module of `cryptography` for Ed25519.

    Raises:
        MissingPackage: `cryptography` is not installed.
    """
    try:
        from cryptography.hazmat.primitives.asymmetric import ed25519 as module
    except ImportError as error:
        raise MissingPackage(
            f"cryptography is not installed, which signatures need: {install_hint('sign')}"
        ) from error
    return module


def key_id(public_key: bytes) -> str:
    """The id of a public key: the first 16 hexadecimal digits of its SHA-256.

    Args:
        public_key: The 32 bytes of the key.
    """
    return hashlib.sha256(public_key).hexdigest()[:_ID_DIGITS]


def is_signed_by(public_key: bytes, signature: bytes, message: bytes) -> bool:
    """Whether a signature of a message is by a key.

    Args:
        public_key: The 32 bytes of the key.
        signature: The signature.
        message: What was signed.

    Raises:
        MissingPackage: `cryptography` is not installed.
    """
    module = ed25519()
    from cryptography.exceptions import InvalidSignature

    try:
        module.Ed25519PublicKey.from_public_bytes(public_key).verify(signature, message)
    except (InvalidSignature, ValueError):
        return False
    return True


def new_key(path: Path, passphrase: str | None = None) -> tuple[Path, str]:
    """Make a key pair: the private key in `path`, the public key beside it with the suffix .pub.

    Only the owner of the private key's file can read it.

    Args:
        path: The file of the private key.
        passphrase: Encrypts the private key; None to leave it plain.

    Returns:
        The file of the public key, and the key's id.

    Raises:
        InputError: One of the files exists or cannot be written, or the passphrase is empty.
        MissingPackage: `cryptography` is not installed.
    """
    module = ed25519()
    from cryptography.hazmat.primitives import serialization

    if not path.name:
        raise InputError(f"private key file is {str(path)!r}: expected the name of a new file")
    public_path = path.with_suffix(".pub")
    for taken in (path, public_path):
        if os.path.lexists(taken):
            raise InputError(f"key file {taken} exists: expected a new name, keys are not replaced")
    if public_path == path:
        raise InputError(f"private key file is {path}: expected a name that does not end in .pub")
    if passphrase == "":
        raise InputError("the passphrase is empty: expected some characters")
    encryption = (
        serialization.NoEncryption()
        if passphrase is None
        else serialization.BestAvailableEncryption(passphrase.encode())
    )
    key = module.Ed25519PrivateKey.generate()
    pem, pkcs8 = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    spki = serialization.PublicFormat.SubjectPublicKeyInfo
    try:
        write_whole(path, key.private_bytes(pem, pkcs8, encryption), _OWNER_ONLY)
        write_whole(public_path, key.public_key().public_bytes(pem, spki))
    except InputFileError as error:
        raise InputError(str(error)) from error
    return public_path, key_id(public_bytes(key))


def public_bytes(key: Ed25519PrivateKey) -> bytes:
    """The 32 bytes of the public key of a private key."""
    return key.public_key().public_bytes_raw()


def read_private_key(path: Path, ask_passphrase: Callable[[], str]) -> Ed25519PrivateKey:
    """Read a private key.

    Args:
        path: a PEM file of `new_key` or another program.
        ask_passphrase: Called if the file is encrypted.

    Raises:
        InputError: The file cannot be read, is no Ed25519 private key, or the passphrase is wrong.
        MissingPackage: `cryptography` is not installed.
    """
    ed25519()
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    key: object
    text = read_small_text(path, "a private key of `edgetree sign --new-key`")
    is_encrypted = "ENCRYPTED" in text
    passphrase = ask_passphrase().encode() if is_encrypted else None
    try:
        key = serialization.load_pem_private_key(text.encode(), passphrase)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, Ed25519PrivateKey):
        doubt = ", or the passphrase is wrong" if is_encrypted else ""
        raise InputError(
            f"key file {path} is not an Ed25519 private key in PEM form{doubt}: expected one of"
            " `edgetree sign --new-key`"
        ) from None  # the reason could quote the key
    return key


def read_public_key(path: Path) -> bytes:
    """Read a public key; returns its 32 bytes.

    Args:
        path: a PEM file of `new_key` or another program.

    Raises:
        InputError: The file cannot be read, or is no Ed25519 public key.
        MissingPackage: `cryptography` is not installed.
    """
    ed25519()
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    key: object
    text = read_small_text(path, "a public key of `edgetree sign --new-key`")
    if "PRIVATE KEY" in text:
        raise InputError(
            f"key file {path} is a private key: expected the public key, whose name ends in .pub;"
            " private keys stay with the signer"
        )
    try:
        key = serialization.load_pem_public_key(text.encode())
    except (ValueError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, Ed25519PublicKey):
        raise InputError(
            f"key file {path} is not an Ed25519 public key in PEM form: expected the .pub file of"
            " `edgetree sign --new-key`"
        )
    return key.public_bytes_raw()
