"""A short run of the fuzzer; ``fuzzing.py`` says how to run a long one."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("torch")
pytest.importorskip("cryptography")
pytest.importorskip("rosbags")
if not Path("/proc/self/statm").exists():
    pytest.skip("the memory of a process is limited on Linux alone", allow_module_level=True)
_FOLDER = str(Path(__file__).parent)
sys.path.insert(0, _FOLDER)
import formats  # noqa: E402
from fuzzing import InputError  # noqa: E402

_BAD_READERS = {
    "error": "{}[path]",
    "memory": "bytearray(2**34)",
    "time": "sum(range(10**12))",
}


def _findings(change: str, count: int) -> str:
    """Fuzz in a process of its own, after a change; its findings, a line each."""
    script = (
        f"import sys; sys.path.insert(0, {_FOLDER!r}); import fuzzing\n{change}\n"
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
    for name, form in formats.FORMATS.items():
        for seed in form.seeds:
            path = tmp_path / f"file-{name}"
            path.write_bytes(seed)
            if form.refused:
                with pytest.raises(InputError, match=form.refused):
                    form.read(path)
            elif form.read(path) is None:
                assert name in ("coco.json", "model.onnx")


def test_what_a_reader_does_wrong_is_found() -> None:
    readers = ", ".join(
        f"{name!r}: Format((b'a',), lambda path: {wrong})" for name, wrong in _BAD_READERS.items()
    )
    change = (
        "from formats.form import Format\nfrom pathlib import Path\n"
        f"fuzzing.FORMATS = {{{readers}}}\n"
        "fuzzing.CORPUS, fuzzing._LONGEST_S = Path('nowhere'), 0"
    )
    found = _findings(change, 8)
    for problem in ("error KeyError", "memory MemoryError", "time the process ended with"):
        assert problem in found
