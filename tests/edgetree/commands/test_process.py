"""Signals during an import, which libraries turn into other errors, end a command as usual."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = """
import ctypes, signal, sys, time
from pathlib import Path
signal.raise_signal({number})
# As libraries in C do; Python then ends itself by SIGINT if the code is interrupted.
if ctypes.pythonapi.PyRun_SimpleString(b"import time; time.sleep(0.3)"):
    raise ImportError("interrupted")
Path({whole!r}).touch()
"""
MAIN = """
import time
from basetree.program.process import run_command_line
def run():
    import fragile
    time.sleep(600)
run_command_line("edgetree", run)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals to send")
@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), (signal.SIGTERM, 143), (getattr(signal, "SIGHUP", 0), 129)],
)
def test_a_signal_during_an_import_ends_the_command_after_it(
    tmp_path: Path, number: int, code: int
) -> None:
    whole = tmp_path / "whole"
    (tmp_path / "fragile.py").write_text(MODULE.format(number=int(number), whole=str(whole)))
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}){MAIN}"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        # A test runner in the background ignores the signal, which child processes inherit.
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    )
    assert (done.returncode, done.stderr) == (code, "edgetree: interrupted\n")
    assert whole.exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals to send")
@pytest.mark.parametrize("name", ["edgetree", "perceptree"])
def test_an_interrupt_while_the_command_line_is_imported_is_one_line(
    tmp_path: Path, name: str
) -> None:
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
    code += f"from {name}.__main__ import main; main()"
    (tmp_path / "typer.py").write_text(
        "import signal, sys\nsignal.raise_signal(signal.SIGINT)"
        f"\nsys.path.remove({str(tmp_path)!r})"
        "\ndel sys.modules['typer']\nimport typer"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert (done.returncode, done.stderr) == (130, f"{name}: interrupted\n")


DROPPED = """
import signal, time
from basetree.program.process import run_command_line

class Closed:
    def __del__(self):
        signal.raise_signal({number})
        time.sleep(0)  # where the interrupt is raised

def run():
    Closed()
    time.sleep(600)

run_command_line("edgetree", run)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals to send")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_that_a_destructor_drops_comes_again(number: int, code: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", DROPPED.format(number=int(number))],
        capture_output=True,
        text=True,
        check=False,
        timeout=30,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert (done.returncode, done.stderr) == (code, "edgetree: interrupted\n")
