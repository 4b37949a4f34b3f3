"""`edgetree sign`, `edgetree trust`, the key files, and every command that opens a model."""

from __future__ import annotations

import json
import os
import stat
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import edgetree.signing.trust
from basetree.errors import MissingPackage
from basetree.files.writing import write_whole
from edgetree import InputError, ModelFileError, TreeDetector
from edgetree.runtime.session import OrtSession
from edgetree.signing import new_key, read_private_key, read_public_key, sign_model
from edgetree.signing.keys import key_id

Machine = Any  # of conftest.py
Cli = Callable[..., Any]


@pytest.fixture
def is_root(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], None]:
    """A function that makes the process root's or another account's."""

    def become(root: bool) -> None:
        monkeypatch.setattr(os, "geteuid", lambda: 0 if root else 1000)

    become(True)
    return become


def test_from_a_new_key_to_an_accepted_model(
    is_root: Callable[[bool], None], machine: Machine, run_cli: Cli, model: Path, tmp_path: Path
) -> None:
    machine.trust_file.unlink()
    made = run_cli("sign", "--new-key", tmp_path / "key.pem")
    identity = key_id(read_public_key(tmp_path / "key.pub"))
    assert made.code == 0
    assert identity in made.out
    signed = run_cli(
        "sign", model, "--key", tmp_path / "key.pem", "--version", 7, "--valid-until", "2039-02-28"
    )
    assert "test-rgb" in signed.out
    assert "until 2039-02-28T23:59:59Z" in signed.out
    assert "none" in run_cli("trust").out
    shown = run_cli("trust", tmp_path / "key.pub", "--require", "--valid-until", "2038-12-31")
    assert f"required by {machine.trust_file}" in shown.out
    assert f"{identity}  key  valid until 2038-12-31T23:59:59Z" in shown.out
    checked = run_cli("trust", "--check", model)
    assert checked.code == 0
    assert "version    7" in checked.out
    assert not machine.used_file.exists()
    OrtSession(model)
    assert "version 7" in run_cli("trust").out
    assert run_cli("trust", "--remove", identity[:6]).code == 0
    assert run_cli("trust", "--check", model).code == 2
    assert "not required" in run_cli("trust", "--no-require").out


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("--new-key", "k.pem", "--valid-until", "2039-02-28"), "--valid-until given with --new"),
        (("--new-key", "k.pem", "--version", "5"), "--version given with --new-key"),
        (("m.onnx", "--key", "k.pem", "--encrypt"), "--encrypt given without --new-key"),
    ],
)
def test_options_that_would_change_nothing_are_refused(
    run_cli: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: Any, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run_cli("sign", *given)
    assert (done.code, list(tmp_path.iterdir())) == (2, [])
    assert message in done.err


def test_an_account_changes_its_own_file(
    is_root: Callable[[bool], None], machine: Machine, run_cli: Cli, other_key: Path
) -> None:
    before = machine.trust_file.read_bytes()
    is_root(False)
    done = run_cli("trust", other_key.with_suffix(".pub"), "--no-require")
    assert f"changed: {machine.own_trust_file}" in done.err
    assert f"not in use  {machine.own_trust_file}" in done.out
    assert key_id(read_public_key(other_key.with_suffix(".pub"))) not in done.out
    assert machine.trust_file.read_bytes() == before


def test_every_account_can_read_the_machines_file(
    is_root: Callable[[bool], None], machine: Machine, run_cli: Cli
) -> None:
    machine.trust_file.unlink()
    machine.trust_file.parent.rmdir()
    before = os.umask(0o077)
    try:
        run_cli("trust", "--no-require")
    finally:
        os.umask(before)
    assert stat.S_IMODE(machine.trust_file.stat().st_mode) == 0o644
    assert stat.S_IMODE(machine.trust_file.parent.stat().st_mode) == 0o755


def test_a_private_key_is_its_owners_alone(machine: Machine) -> None:
    assert stat.S_IMODE(machine.key.stat().st_mode) == 0o600
    content = machine.key.read_bytes()
    with pytest.raises(InputError, match="keys are not replaced"):
        new_key(machine.key)
    assert machine.key.read_bytes() == content


def test_a_file_has_its_permissions_from_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "fchmod", lambda descriptor, mode: None)
    write_whole(tmp_path / "file", b"", 0o600)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o600


def test_an_encrypted_key_needs_its_passphrase(
    machine: Machine, run_cli: Cli, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    typed = iter(["secret", "secret", "secret", "wrong"])
    monkeypatch.setattr("typer.prompt", lambda *args, **options: next(typed))
    typed = iter(["secret", "secret", "wrong"])
    path = tmp_path / "key.pem"
    assert run_cli("sign", "--new-key", path, "--encrypt").code == 0
    assert b"ENCRYPTED" in path.read_bytes()
    assert run_cli("sign", model, "--key", path).code == 0
    refused = run_cli("sign", model, "--key", path)
    assert refused.code == 2
    assert "passphrase is wrong" in refused.err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("sign",), "MODEL or --key is missing"),
        (("sign", "{model}"), "MODEL or --key is missing"),
        (("sign", "{model}", "--key", "none.pem"), "none.pem does not exist"),
        (("sign", "{model}", "--key", "{public}"), "is not an Ed25519 private key"),
        (("sign", "{model}", "--key", "{model}"), "not a text file"),
        (("sign", "none.onnx", "--key", "{key}"), "model none.onnx does not exist"),
        (("sign", "{key}", "--key", "{key}"), "is not an ONNX model"),
        (("sign", "{model}", "--key", "{key}", "--version", "0"), "version is '0'"),
        (("sign", "{model}", "--key", "{key}", "--name", " "), "name is ' '"),
        (("sign", "{model}", "--key", "{key}", "--valid-until", "2001-01-01"), "a time after"),
        (("sign", "{model}", "--key", "{key}", "--valid-until", "soon"), "expected a date"),
        (("sign", "{model}", "--new-key", "a.pem"), "expected only one of them"),
        (("sign", "--new-key", "a.pub"), "does not end in .pub"),
        (("sign", "--new-key", ""), "expected the name of a new file"),
        (("sign", "--new-key", "none/a.pem"), "cannot be written"),
        (("trust", "{key}"), "is a private key: expected the public key"),
        (("trust", "{model}"), "not a text file"),
        (("trust", "--remove", "0123"), "expected the id of one key"),
        (("trust", "--valid-until", "2038-01-01"), "without KEY"),
        (("trust", "{public}", "--valid-until", "2001-01-01"), "expected today or a later day"),
        (("trust", "--check", "none.onnx"), "model none.onnx does not exist"),
        (("trust", "--check", "{model}", "--require"), "expected only one of them"),
        (("trust", "--check", "{model}"), "has no signature"),
    ],
)
def test_wrong_usage_is_told_in_one_line(
    is_root: Callable[[bool], None],
    machine: Machine,
    run_cli: Cli,
    model: Path,
    arguments: tuple[str, ...],
    expected: str,
) -> None:
    names = {"model": model, "key": machine.key, "public": machine.key.with_suffix(".pub")}
    done = run_cli(*(argument.format(**names) for argument in arguments))
    assert done.code == 2
    assert expected in done.err
    assert done.err.count("\n") == 1
    assert machine.key.read_text().splitlines()[1] not in done.err


def test_keys_of_other_kinds_are_refused(machine: Machine, tmp_path: Path) -> None:
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    pem = serialization.Encoding.PEM
    (tmp_path / "ec.pem").write_bytes(
        key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    (tmp_path / "ec.pub").write_bytes(
        key.public_key().public_bytes(pem, serialization.PublicFormat.SubjectPublicKeyInfo)
    )
    with pytest.raises(InputError, match="not an Ed25519 private key"):
        read_private_key(tmp_path / "ec.pem", lambda: "")
    with pytest.raises(InputError, match="not an Ed25519 public key"):
        read_public_key(tmp_path / "ec.pub")


def test_a_model_without_a_manifest_is_not_signed(
    machine: Machine, write_model: Callable[..., Path], rgb_manifest: Any
) -> None:
    path = write_model(rgb_manifest, "plain.onnx", with_manifest=False)
    with pytest.raises(ModelFileError, match="has no manifest"):
        sign_model(path, read_private_key(machine.key, lambda: ""))


def test_without_cryptography_the_extra_is_named(
    machine: Machine, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine.sign(model)
    monkeypatch.setitem(sys.modules, "cryptography.hazmat.primitives.asymmetric", None)
    with pytest.raises(MissingPackage, match=r"\.\[sign\]"):
        TreeDetector.load(model)


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "{images}", "--model", "{model}"),
        ("measure", "{images}/a.jpg", "--model", "{model}", "--depth", "{depth}/a.png"),
        ("bench", "{model}"),
        ("eval", "{model}", "{images}"),
    ],
)
@pytest.mark.parametrize("by_option", [True, False])
def test_every_command_refuses_a_model_without_a_signature(
    machine: Machine,
    run_cli: Cli,
    images: Path,
    model: Path,
    arguments: tuple[str, ...],
    by_option: bool,
) -> None:
    machine.trusts(machine.entry(), required=not by_option)
    names = {"images": images, "model": model, "depth": images.parent / "depth"}
    camera = ("--camera", images.parent / "camera.json") if arguments[0] == "measure" else ()
    option = ("--require-signature",) if by_option else ()
    done = run_cli(*option, *(argument.format(**names) for argument in arguments), *camera)
    assert done.code == 2
    assert "has no signature" in done.err


def test_verify_refuses_a_model_without_a_signature(
    machine: Machine, run_cli: Cli, images: Path, model: Path
) -> None:
    pytest.importorskip("torch")
    checkpoint = model.with_suffix(".safetensors")
    checkpoint.write_bytes(b"")
    done = run_cli("verify", model, checkpoint, "--data", images)
    assert done.code == 2
    assert "has no signature" in done.err


@pytest.mark.parametrize(
    "arguments",
    [("demo", "--train", "--out", "{out}"), ("bench", "--backbones", "r50", "--models", "{out}")],
)
def test_what_makes_models_itself_is_refused_at_once(
    machine: Machine, run_cli: Cli, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    done = run_cli(*(argument.format(out=tmp_path / "out") for argument in arguments))
    assert done.code == 2
    assert "without a signature" in done.err or "gives no signature" in done.err
    assert not (tmp_path / "out").exists()


def test_the_processes_of_bench_require_signatures_too(
    machine: Machine, run_cli: Cli, model: Path, tmp_path: Path
) -> None:
    machine.trusts(machine.entry(), required=False)
    (tmp_path / "r50-fp32-32x32.onnx").write_bytes(model.read_bytes())
    size = ("--size", "32x32", "--seconds", 0)
    done = run_cli(
        "--require-signature", "bench", "--backbones", "r50", "--models", tmp_path, *size
    )
    assert done.code == 2
    assert "has no signature" in done.err


def test_the_trust_file_is_json_with_a_schema(machine: Machine) -> None:
    values = json.loads(machine.trust_file.read_text())
    assert values["schema"] == "edgetree.trust/1"
    assert values["require_signature"] is True
    assert edgetree.signing.trust.read_trust_file(machine.trust_file).keys == (machine.entry(),)
