"""A short run of the fuzzer; ``fuzzing.py`` says how to run a long one."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("resource")
_FUZZING = Path(__file__).with_name("fuzzing.py")
_SPEC = importlib.util.spec_from_file_location("fuzzing", _FUZZING)
assert _SPEC is not None
assert _SPEC.loader is not None
fuzzing = importlib.util.module_from_spec(_SPEC)
sys.modules["fuzzing"] = fuzzing
_SPEC.loader.exec_module(fuzzing)

_BAD_READERS = {
    "error": "raise KeyError(path)",
    "memory": "bytearray(2**34)",
    "time": "while True: pass",
}


def _findings(change: str, count: int) -> str:
    """Fuzz in a process of its own, after a change; its findings, a line each."""
    script = (
        f"import sys; sys.path.insert(0, {str(_FUZZING.parent)!r}); import fuzzing\n{change}\n"
        f"for finding in fuzzing.fuzz({count}):\n"
        "    print(finding.format, finding.problem, finding.data.hex())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=600, check=True
    )
    return done.stdout


def test_mutated_files_are_read_or_refused() -> None:
    assert _findings("", 2000) == ""


def test_the_seeds_are_valid(tmp_path: Path) -> None:
    for name, form in fuzzing.FORMATS.items():
        for seed in form.seeds:
            path = tmp_path / f"file-{name}"
            path.write_bytes(seed)
            form.read(path)


@pytest.mark.parametrize("problem", _BAD_READERS)
def test_what_a_reader_does_wrong_is_found(problem: str) -> None:
    change = (
        f"from pathlib import Path\ndef read(path):\n    {_BAD_READERS[problem]}\n"
        "fuzzing.FORMATS = {'camera': fuzzing.Format((b'a',), read)}\n"
        "fuzzing.CORPUS, fuzzing._LONGEST_S = Path('nowhere'), 0"
    )
    expected = {"error": "KeyError", "memory": "MemoryError", "time": "the process ended with"}
    assert expected[problem] in _findings(change, 1)
