"""A short run of the fuzzer; ``fuzzing.py`` says how to run a long one."""

import importlib.util
import sys
from pathlib import Path

import pytest

pytest.importorskip("resource")
_SPEC = importlib.util.spec_from_file_location("fuzzing", Path(__file__).with_name("fuzzing.py"))
assert _SPEC is not None
assert _SPEC.loader is not None
fuzzing = importlib.util.module_from_spec(_SPEC)
sys.modules["fuzzing"] = fuzzing
_SPEC.loader.exec_module(fuzzing)


def test_mutated_files_are_read_or_refused() -> None:
    assert fuzzing.fuzz(2000) == []


def test_the_seeds_are_valid(tmp_path: Path) -> None:
    for name, form in fuzzing.FORMATS.items():
        for seed in form.seeds:
            path = tmp_path / f"file-{name}"
            path.write_bytes(seed)
            form.read(path)


@pytest.mark.parametrize("problem", ["error", "memory", "time"])
def test_what_a_reader_does_wrong_is_found(problem: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def read(path: Path) -> None:
        if problem == "error":
            raise KeyError(path)
        if problem == "memory":
            _ = bytearray(2**34)
        while problem == "time":
            pass

    monkeypatch.setattr(fuzzing, "FORMATS", {"camera": fuzzing.Format((b"a",), read)})
    monkeypatch.setattr(fuzzing, "CORPUS", Path("nowhere"))
    monkeypatch.setattr(fuzzing, "_LONGEST_S", 0)
    (finding,) = fuzzing.fuzz(1)
    expected = {"error": "KeyError", "memory": "MemoryError", "time": "the process ended with"}
    assert expected[problem] in finding.problem
