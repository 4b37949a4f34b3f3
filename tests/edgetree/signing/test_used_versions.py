"""The file of used versions: several processes at once, and clocks that are set back."""

from __future__ import annotations

import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from edgetree.errors import SignatureError
from edgetree.runtime.session import OrtSession
from edgetree.signing import check_signature, current_trust
from edgetree.signing.statement import Statement
from edgetree.signing.used_versions import read_used, record_use

Machine = Any  # of conftest.py

_NOW = datetime(2026, 11, 23, tzinfo=UTC)
_RECORD = """
import sys
from datetime import UTC, datetime
from pathlib import Path
from edgetree.signing.statement import Statement
from edgetree.signing.used_versions import record_use

print("ready", flush=True)
sys.stdin.readline()
for number in range(20):
    name = f"{sys.argv[2]}-{number}"
    statement = Statement(name, 1, 100, "0" * 64, "2026-11-23T08:00:00Z")
    now = datetime(2026, 11, 23, tzinfo=UTC)
    record_use(statement, Path("model.onnx"), Path(sys.argv[1]), now)
"""


def _statement(version: int) -> Statement:
    return Statement("pine", version, 100, "0" * 64, "2026-11-23T08:00:00Z")


def test_processes_that_record_at_once_lose_nothing(tmp_path: Path) -> None:
    file = tmp_path / "used.json"
    command = [sys.executable, "-c", _RECORD, str(file)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    running = [subprocess.Popen([*command, name], **pipes) for name in "abc"]
    for process in running:
        process.stdout.readline()
    for process in running:
        process.stdin.write("go\n")
        process.stdin.flush()
    for process in running:
        process.communicate(timeout=60)
        assert process.returncode == 0
    expected = {f"{name}-{number}" for name in "abc" for number in range(20)}
    assert {model.name for model in read_used(file).models} == expected


def test_an_older_version_that_was_checked_first_is_refused(machine: Machine, model: Path) -> None:
    machine.sign(model, version=4)
    older = check_signature(model, current_trust())
    machine.sign(model, version=5)
    newer = check_signature(model, current_trust())
    newer.record_use()
    with pytest.raises(SignatureError, match=r"is version 4 of .*, and version 5 was used here"):
        older.record_use()
    assert read_used(machine.used_file).models[0].version == 5


def test_an_older_version_is_refused_while_the_newer_one_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "used.json"
    record_use(_statement(1), Path("model.onnx"), file, _NOW)
    before = read_used(file)
    record_use(_statement(3), Path("model.onnx"), file, _NOW)
    states = iter([before])
    monkeypatch.setattr(
        "edgetree.signing.used_versions.read_used",
        lambda path: next(states, None) or read_used(path),
    )
    with pytest.raises(SignatureError, match="version 3 was used here before"):
        record_use(_statement(2), Path("model.onnx"), file, _NOW)


@pytest.mark.parametrize("content", ["{", '{"schema": "edgetree.used-versions/1", "models": 3}'])
def test_a_broken_file_is_refused_and_kept(tmp_path: Path, content: str) -> None:
    file = tmp_path / "used.json"
    file.write_text(content)
    with pytest.raises(SignatureError, match=r"used\.json"):
        record_use(_statement(1), Path("model.onnx"), file, _NOW)
    assert file.read_text() == content


def refusal(model: Path) -> str:
    with pytest.raises(SignatureError) as refused:
        OrtSession(model)
    return str(refused.value)


def test_a_clock_that_is_set_back_makes_nothing_valid_again(machine: Machine, model: Path) -> None:
    machine.sign(model, valid_until="2037-12-31T23:59:59Z")
    start = machine.now
    OrtSession(model)
    machine.now = start.replace(year=2037)
    OrtSession(model)
    machine.now = start.replace(year=2039)
    unlimited = machine.sign(model).read_text()
    OrtSession(model)
    machine.now = start
    OrtSession(model)
    machine.sign(model, valid_until="2037-12-31T23:59:59Z")
    assert "and it said 2039-" in refusal(model)
    model.with_name(f"{model.name}.sig").write_text(unlimited)
    OrtSession(model)


def test_what_was_refused_as_expired_stays_refused(machine: Machine, model: Path) -> None:
    machine.sign(model, valid_until="2037-12-31T23:59:59Z")
    start = machine.now
    OrtSession(model)
    machine.now = start.replace(year=2038)
    assert "was valid until 2037-12-31" in refusal(model)
    machine.now = start
    assert "and it said 2038-" in refusal(model)


def test_the_time_of_a_refused_key_stays_too(machine: Machine, model: Path) -> None:
    machine.trusts(machine.entry("2037-12-31T23:59:59Z"))
    machine.sign(model)
    start = machine.now
    machine.now = start.replace(year=2038)
    refusal(model)
    machine.now = start
    assert "and it said 2038-" in refusal(model)
