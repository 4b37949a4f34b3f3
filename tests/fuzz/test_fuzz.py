"""A short run of the fuzzer; ``fuzzing.py`` says how to run a long one."""

import logging
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("torch")
pytest.importorskip("cryptography")
pytest.importorskip("rosbags")
pytest.importorskip("lzfse")
if not Path("/proc/self/statm").exists():
    pytest.skip("the memory of a process is limited on Linux alone", allow_module_level=True)
_FOLDER = str(Path(__file__).parent)
sys.path.insert(0, _FOLDER)
import formats  # noqa: E402
from fuzzing import InputError  # noqa: E402

_BAD_READERS = {
    "error": "{}[path]",
    "zeroed": "bytearray(3 * 2**29)",
    "untouched": "np.empty(3 * 2**29, np.uint8)",
    "freed": "np.zeros(3 * 2**29, np.uint8).shape",
    "used": "np.ones(2**34, np.uint8)",
    "refused": "swallowed(lambda: np.empty(2**60, np.uint8))",
    "opencv": "swallowed(lambda: cv2.copyMakeBorder(PIXEL, 0, 2**30, 0, 2**30, 0))",
    "header": "swallowed(lambda: cv2.imdecode(CHUNK, 1))",
    "little": "bytearray(2**27)",
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
    # No format silences the tests that come after it.
    assert logging.getLogger("edgetree").isEnabledFor(logging.WARNING)


_HELPERS = """
import contextlib, cv2, numpy as np
from formats.form import Format
from pathlib import Path
PIXEL = np.ones((1, 1), np.uint8)
packed = cv2.imencode('.png', PIXEL)[1].tobytes()
at = packed.find(b'IDAT')
CHUNK = np.frombuffer(packed[:at - 4] + b'\\xff\\xff\\xff\\xf0' + packed[at:], np.uint8)
def swallowed(read):
    with contextlib.suppress(Exception):
        read()
"""


def test_what_a_reader_does_wrong_is_found() -> None:
    readers = ", ".join(
        f"{name!r}: Format((b'a',), lambda path: {wrong})" for name, wrong in _BAD_READERS.items()
    )
    change = f"{_HELPERS}\nfuzzing.FORMATS = {{{readers}}}\n" + (
        "fuzzing.CORPUS, fuzzing._LONGEST_S = Path('nowhere'), 2\n"
        "fuzzing._MOST_USED_BYTES = 2**29\n"
        "fuzzing.cases = lambda count, seed: [(name, b'a') for name in fuzzing.FORMATS]"
    )
    found = _findings(change, 1)
    for problem in ("error KeyError", "time the process ended with"):
        assert problem in found
    for name in ("zeroed", "untouched", "freed", "used", "refused", "opencv", "header"):
        assert re.search(rf"^{name} (memory: |MemoryError)", found, re.MULTILINE), (name, found)
    assert "little" not in found
