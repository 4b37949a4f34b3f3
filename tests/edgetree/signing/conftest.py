"""A machine with trust files of its own, a signer's key, and a clock that tests can set."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import edgetree.signing.trust
import edgetree.signing.verify
from edgetree.catalogue import default_model
from edgetree.model_file.manifest import METADATA_KEY, Manifest
from edgetree.model_file.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.model_file.safety_check import read_model_file
from edgetree.signing.keys import new_key, read_private_key, read_public_key
from edgetree.signing.sign import sign_model
from edgetree.signing.trust import TrustedKey, TrustFile, write_trust_file


@dataclass
class Machine:
    """A machine that requires signatures by one key, and the signer's key.

    Its clock is an hour ahead of the signer's.
    """

    folder: Path
    key: Path
    now: datetime = field(default_factory=lambda: datetime.now(UTC) + timedelta(hours=1))

    @property
    def trust_file(self) -> Path:
        return self.folder / "etc" / "trust.json"

    @property
    def own_trust_file(self) -> Path:
        return self.folder / "config" / "edgetree" / "trust.json"

    @property
    def used_file(self) -> Path:
        return self.folder / "state" / "edgetree" / "edgetree-used-versions.json"

    def entry(self, valid_until: str | None = None) -> TrustedKey:
        return TrustedKey.of(read_public_key(self.key.with_suffix(".pub")), "office", valid_until)

    def trusts(self, *keys: TrustedKey, required: bool = True) -> None:
        write_trust_file(self.trust_file, TrustFile(required, keys))

    def sign(self, model: Path, **statement: Any) -> Path:
        key = read_private_key(self.key, lambda: "")
        return sign_model(model, key, **statement)[0]


@pytest.fixture
def empty_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Machine:
    """A machine without trust files, for a key that is not made."""
    folder = tmp_path / "machine"
    monkeypatch.setattr(edgetree.signing.trust, "_MACHINE_FOLDER", folder / "etc")
    monkeypatch.setattr(edgetree.signing.verify, "_required_in_process", False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder / "config"))
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "state"))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    made = Machine(folder, tmp_path / "office.pem")
    monkeypatch.setattr(edgetree.signing.verify, "_now", lambda: made.now)
    return made


@pytest.fixture
def machine(empty_machine: Machine) -> Machine:
    """A machine that requires signatures by the key `office.pem`."""
    pytest.importorskip("cryptography")
    new_key(empty_machine.key)
    empty_machine.trusts(empty_machine.entry())
    return empty_machine


@pytest.fixture
def other_key(tmp_path: Path) -> Path:
    """A key that the machine does not trust."""
    pytest.importorskip("cryptography")
    new_key(tmp_path / "other.pem")
    return tmp_path / "other.pem"


@cache
def manifest() -> Manifest:
    return Manifest.from_json(read_model_file(default_model("rgb")).metadata[METADATA_KEY])


def write_model_trained_on(path: Path, training_data: str) -> Path:
    """Write the smallest model that can be signed and opened, named "test-rgb"."""
    shape = TensorType("float32", (1, 3))
    described = replace(manifest(), name="test-rgb", training_data=training_data)
    content = onnx_bytes(
        [Node("Relu", ("x",), ("y",))],
        inputs={"x": shape},
        outputs={"y": shape},
        constants={},
        metadata={METADATA_KEY: described.to_json()},
    )
    path.write_bytes(content)
    return path


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A model file that can be signed and opened, named "test-rgb" and trained on "one"."""
    return write_model_trained_on(tmp_path / "model.onnx", "one")


@pytest.fixture
def another(tmp_path: Path) -> Path:
    """Another file of the same name, trained on "two"."""
    return write_model_trained_on(tmp_path / "another.onnx", "two")
