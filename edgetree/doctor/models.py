"""The models that this machine finds by name, so that one can see which machine has which."""

from __future__ import annotations

import hashlib
from pathlib import Path

from edgetree.catalogue import known_models
from edgetree.doctor.findings import ModelFile
from edgetree.errors import SignatureError
from edgetree.signing.verify import parse_signature, signature_file


def examine_models() -> tuple[ModelFile, ...]:
    """The models of `edgetree.catalogue.known_models`: the four of the package, and the user's.

    Raises:
        InputError: a folder in EDGETREE_MODELS does not exist.
        OSError: a file cannot be read.
    """
    return tuple(
        ModelFile(
            model.name,
            str(model.path),
            hashlib.sha256(model.path.read_bytes()).hexdigest(),
            _version(model.path),
        )
        for model in known_models()
    )


def _version(model: Path) -> int | None:
    """The version in a model's signature, which is not checked here; None if there is none."""
    try:
        return parse_signature(signature_file(model).read_bytes()).version
    except (FileNotFoundError, SignatureError):
        return None
