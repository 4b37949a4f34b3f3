"""A machine that requires signatures opens the signed model, and refuses everything else."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

import edgetree.runtime.session
from edgetree import SignatureError, TreeDetector, default_model
from edgetree.model_file.manifest import METADATA_KEY
from edgetree.runtime.providers import SessionSettings
from edgetree.runtime.session import OrtSession
from edgetree.signing import parse_signature, require_signatures
from edgetree.signing.envelope import parse_envelope
from edgetree.signing.trust import TrustFile, write_trust_file

Machine = Any  # of conftest.py
Change = Callable[[Machine, Path], object]


def refusal(model: Path) -> str:
    """The message of a model that is refused, which is one line."""
    with pytest.raises(SignatureError) as refused:
        OrtSession(model)
    message = str(refused.value)
    assert "\n" not in message
    return message


def signature_of(model: Path) -> Path:
    return model.with_name(f"{model.name}.sig")


def test_a_signed_model_opens(machine: Machine, model: Path) -> None:
    machine.sign(model)
    assert OrtSession(model).name == str(model)
    link = model.with_name("link.onnx")
    link.symlink_to(model)
    assert OrtSession(link).name == str(link)


def test_a_model_opens_without_a_signature_where_none_is_required(
    machine: Machine, model: Path
) -> None:
    machine.trusts(machine.entry(), required=False)
    OrtSession(model)
    with pytest.raises(SignatureError, match="has no signature"):
        TreeDetector.load(model, require_signature=True)
    require_signatures()
    assert "has no signature" in refusal(model)


@pytest.mark.parametrize("at", [0, 1000, -1])
def test_a_changed_byte_of_the_model_is_refused(machine: Machine, model: Path, at: int) -> None:
    machine.sign(model)
    content = bytearray(model.read_bytes())
    content[at] ^= 1
    model.write_bytes(content)
    assert "it was changed, or is another file" in refusal(model)


def test_a_longer_model_is_refused(machine: Machine, model: Path) -> None:
    machine.sign(model)
    model.write_bytes(model.read_bytes() + b"\0")
    assert "it was changed, or is another file" in refusal(model)


def test_changed_bytes_of_the_signature_are_refused(machine: Machine, model: Path) -> None:
    file = machine.sign(model)
    whole = file.read_bytes()
    said = parse_envelope(whole.decode())
    for at in range(0, len(whole), 7):
        changed = bytearray(whole)
        changed[at] ^= 1
        file.write_bytes(changed)
        try:
            again = parse_envelope(changed.decode("utf-8", "replace"))
        except SignatureError:
            again = None
        if again != said:  # else a space of the JSON
            refusal(model)


def edited(file: Path, **values: object) -> None:
    """Change the statement in a signature, but not the signature of it."""
    envelope = parse_envelope(file.read_text())
    statement = json.loads(envelope.payload) | values
    file.write_text(replace(envelope, payload=json.dumps(statement).encode()).to_json())


def remove_key(machine: Machine, model: Path) -> None:
    machine.trusts()


def rename_signature(machine: Machine, model: Path) -> None:
    other = model.with_name("other.onnx")
    other.write_bytes(model.read_bytes()[:-1] + b"x")
    content = other.read_bytes()
    signature_of(model).rename(signature_of(other))
    model.write_bytes(content)
    signature_of(other).rename(signature_of(model))


def set_clock(**shift: float) -> Change:
    def change(machine: Machine, model: Path) -> None:
        machine.now += timedelta(**shift)

    return change


def expire_key(machine: Machine, model: Path) -> None:
    machine.trusts(machine.entry("2026-01-01T23:59:59Z"))


def write_signature(content: str) -> Change:
    return lambda machine, model: signature_of(model).write_text(content)


def make_fifo(machine: Machine, model: Path) -> None:
    signature_of(model).unlink()
    os.mkfifo(signature_of(model))


def make_folder(machine: Machine, model: Path) -> None:
    signature_of(model).unlink()
    signature_of(model).mkdir()


CHANGES: dict[str, tuple[Change, str]] = {
    "missing": (lambda machine, model: signature_of(model).unlink(), "has no signature"),
    "raised version": (
        lambda machine, model: edited(signature_of(model), version=10**14),
        "it was changed, or is not by the key",
    ),
    "removed key": (
        remove_key,
        "is not trusted: expected a key of .*trust.json, which trust no key",
    ),
    "of another file": (rename_signature, "it was changed, or is another file"),
    "expired": (set_clock(days=5000), r"was valid until 2037-12-31T23:59:59Z, and the clock says"),
    "not yet valid": (set_clock(days=-2), "is valid from .* expected a correct clock"),
    "expired key": (expire_key, r"key [0-9a-f]{16} \(office\) was valid until 2026-01-01"),
    "empty": (write_signature(""), "is not JSON"),
    "a list": (write_signature("[]"), "is a list of 0 items, expected an object"),
    "nested": (write_signature("[" * 100_000), "is not JSON"),
    "huge": (write_signature(" " * 3_000_000), "larger than 2097152 bytes"),
    "huge number": (write_signature('{"payloadType": ' + "9" * 10_000 + "}"), "is not JSON"),
    "repeated key": (
        write_signature('{"payloadType": "a", "payloadType": "b"}'),
        "payloadType is given twice",
    ),
    "fifo": (make_fifo, "is not a regular file"),
    "folder": (make_folder, "is not a regular file"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_is_refused(machine: Machine, model: Path, name: str) -> None:
    change, expected = CHANGES[name]
    machine.sign(model, valid_until="2037-12-31T23:59:59Z")
    OrtSession(model)
    machine.used_file.unlink()
    change(machine, model)
    with pytest.raises(SignatureError, match=expected):
        OrtSession(model)
    refusal(model)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("payloadType", "text/plain", "payloadType is 'text/plain'"),
        ("payload", "?", "not base64"),
        ("signatures", [], "has 0 signatures: expected one"),
        ("signatures", [{"keyid": 1, "sig": ""}], "signatures[0].keyid is 1, expected text"),
    ],
)
def test_a_malformed_envelope_is_refused(
    machine: Machine, model: Path, name: str, value: object, expected: str
) -> None:
    file = machine.sign(model)
    file.write_text(json.dumps(json.loads(file.read_text()) | {name: value}))
    assert expected in refusal(model)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("schema", "edgetree.model-signature/2"),
        ("name", ""),
        ("name", "a\nb"),
        ("version", 0),
        ("version", True),
        ("file_bytes", -1),
        ("file_sha256", "0"),
        ("valid_from", "today"),
        ("valid_until", "2001-01-01T00:00:00Z"),
    ],
)
def test_a_malformed_statement_is_refused(
    machine: Machine, model: Path, name: str, value: object
) -> None:
    file = machine.sign(model)
    assert parse_signature(file.read_bytes()).name == "test-rgb"
    edited(file, **{name: value})
    with pytest.raises(SignatureError, match=name if name != "valid_from" else "time"):
        parse_signature(file.read_bytes())


def test_another_key_is_refused(machine: Machine, model: Path, other_key: Path) -> None:
    trusted, machine.key = machine.key, other_key
    file = machine.sign(model)
    assert "is not trusted" in refusal(model)
    forged = json.loads(file.read_text())
    machine.key = trusted
    forged["signatures"][0]["keyid"] = machine.entry().id
    file.write_text(json.dumps(forged))
    assert "is not by the key" in refusal(model)


def test_an_older_version_is_refused(machine: Machine, model: Path) -> None:
    machine.sign(model, version=4)
    old = signature_of(model).read_text()
    machine.sign(model, version=5)
    OrtSession(model)
    OrtSession(model)
    signature_of(model).write_text(old)
    expected = "is version 4 of 'test-rgb', and version 5 was used here before"
    assert expected in refusal(model)
    machine.sign(model, version=4, name="of the other camera")
    OrtSession(model)


def test_a_version_names_one_file(machine: Machine, model: Path, another: Path) -> None:
    machine.sign(model, version=4)
    machine.sign(another, version=4)
    OrtSession(model)
    assert "another file of that version was used here before" in refusal(another)
    machine.sign(model, version=4, valid_until="2037-12-31T23:59:59Z")
    OrtSession(model)


def test_a_version_that_cannot_be_recorded_is_refused(machine: Machine, model: Path) -> None:
    machine.sign(model)
    machine.used_file.parent.parent.write_text("a file where the folder should be")
    assert "cannot be recorded in" in refusal(model)


def test_a_later_time_that_cannot_be_recorded_is_a_warning(
    machine: Machine, model: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    machine.sign(model)
    OrtSession(model)

    def full(path: Path, content: bytes) -> None:
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("edgetree.signing.used_versions.write_whole", full)
    OrtSession(model)
    assert not caplog.records
    machine.now += timedelta(days=2)
    OrtSession(model)
    assert "No space left on device" in caplog.text


@pytest.mark.parametrize("content", ["", "{}", '{"schema": "x"}', "[]", "[" * 100_000])
def test_broken_files_of_the_machine_are_refused(
    machine: Machine, model: Path, content: str
) -> None:
    machine.sign(model)
    machine.used_file.parent.mkdir(parents=True)
    machine.used_file.write_text(content)
    assert str(machine.used_file) in refusal(model)
    machine.trust_file.write_text(content)
    assert str(machine.trust_file) in refusal(model)


def test_a_services_versions_are_in_its_state_folder(
    machine: Machine, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", f"{tmp_path / 'var'}:/other")
    machine.sign(model, version=3)
    OrtSession(model)
    (entry,) = json.loads((tmp_path / "var" / machine.used_file.name).read_text())["models"]
    assert (entry["name"], entry["version"]) == ("test-rgb", 3)


def test_an_account_cannot_weaken_the_machine(
    machine: Machine, model: Path, other_key: Path
) -> None:
    trusted, machine.key = machine.key, other_key
    machine.sign(model)
    write_trust_file(machine.own_trust_file, TrustFile(False, (machine.entry(),)))
    assert "is not trusted" in refusal(model)
    machine.key = trusted
    machine.trusts(machine.entry(), required=False)
    OrtSession(model, SessionSettings(require_signature=True))


def test_an_account_can_require_signatures(machine: Machine, model: Path) -> None:
    machine.trust_file.unlink()
    write_trust_file(machine.own_trust_file, TrustFile(True, (machine.entry(),)))
    assert f"required by {machine.own_trust_file}" in refusal(model)
    machine.sign(model)
    OrtSession(model)


def test_the_packaged_models_need_no_signature(machine: Machine, tmp_path: Path) -> None:
    machine.trust_file.write_text("broken")
    OrtSession(default_model("rgb"))
    link = tmp_path / "link.onnx"
    link.symlink_to(default_model("rgb"))
    OrtSession(link)
    machine.trusts()
    copy = tmp_path / "rgb.onnx"
    copy.write_bytes(default_model("rgb").read_bytes())
    assert "has no signature" in refusal(copy)


def test_a_model_of_the_callers_own_needs_no_signature(machine: Machine, model: Path) -> None:
    session = OrtSession(Path("the exported model"), content=model.read_bytes())
    assert session.name == "the exported model"


def test_the_checked_content_is_what_is_opened(
    machine: Machine, model: Path, another: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine.sign(model)
    check = edgetree.runtime.session.check_content

    def check_and_swap(content: bytes, path: Path) -> object:
        another.replace(path)
        return check(content, path)

    monkeypatch.setattr(edgetree.runtime.session, "check_content", check_and_swap)
    assert '"one"' in OrtSession(model).metadata[METADATA_KEY]
    assert b'"two"' in model.read_bytes()


def test_nothing_unsigned_opens_without_cryptography_either(
    empty_machine: Machine, model: Path
) -> None:
    OrtSession(model)
    empty_machine.trusts()
    assert "has no signature" in refusal(model)


@pytest.mark.parametrize("name", ["trust_file", "own_trust_file"])
def test_a_trust_file_out_of_reach(
    empty_machine: Machine, model: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    hidden = getattr(empty_machine, name)
    lstat = os.lstat

    def refuse(path: Any, **options: Any) -> os.stat_result:
        if path == hidden:
            raise PermissionError(13, "Permission denied")
        return lstat(path, **options)

    monkeypatch.setattr(os, "lstat", refuse)
    if name == "trust_file":
        assert f"{hidden} cannot be read (Permission denied)" in refusal(model)
    else:  # in the home folder of another account
        OrtSession(model)


def test_models_are_opened_in_one_place() -> None:
    package = Path(edgetree.__file__).parent
    found = {
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        for call in ("onnxruntime.InferenceSession(", " open_session(")
        if call in path.read_text("utf-8")
    }
    # The models of the doctor, of the machine's peak and of an export are made in memory.
    in_memory = {"doctor/providers.py", "bench/peak.py", "export/rounding.py"}
    assert found == {"runtime/ort_session.py", "runtime/session.py"} | in_memory
