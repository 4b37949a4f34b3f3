"""No test reads or writes the trust files of the machine and the account that run it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from edgetree.signing.trust import account_file, machine_file

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no machine's file")
ROOT = Path(__file__).resolve().parents[3]
TELL = "from edgetree.signing.trust import machine_file, account_file as own"
TELL += "\nprint(machine_file(), own())"
IN_A_PROCESS = "import multiprocessing\nfrom edgetree.signing.trust import machine_file"
IN_A_PROCESS += """
if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(pool.apply(machine_file))
"""


def told(code: str, tmp_path: Path, **how: object) -> list[str]:
    script = tmp_path / "tell.py"
    script.write_text(f"import sys\nsys.path.insert(0, {str(ROOT)!r})\n{code}\n")
    return subprocess.check_output([sys.executable, script], text=True, **how).split()


def test_this_process_has_files_of_its_own(tmp_path: Path) -> None:
    assert str(machine_file()) == os.path.join(os.environ["EDGETREE_TESTS_MACHINE"], "trust.json")
    for path in (machine_file(), account_file()):
        assert "edgetree-tests-" in str(path)
        assert not path.exists()


SEEN: set[Path] = set()


@pytest.mark.parametrize("_number", range(2))
def test_each_test_has_another_machine(_number: int) -> None:
    assert machine_file() not in SEEN
    SEEN.add(machine_file())


@pytest.mark.parametrize(
    "how",
    [{}, {"env": {"PATH": os.environ["PATH"]}}, {"env": {"PYTHONPATH": str(ROOT)}}],
    ids=["inherits", "bare", "path"],
)
def test_a_process_that_a_test_starts_has_them_too(tmp_path: Path, how: dict[str, object]) -> None:
    machine, own = told(TELL, tmp_path, **how)
    assert machine == str(machine_file())
    assert own == str(account_file()) or "env" in how


def test_processes_of_processes_have_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    assert told(IN_A_PROCESS, tmp_path) == [str(machine_file())]
