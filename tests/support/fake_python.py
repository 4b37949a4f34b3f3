"""A Python that does something else than it is told, for programs that start processes."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import pytest


def replace_python(patch: pytest.MonkeyPatch, folder: Path, script: str) -> None:
    """Processes that are started with `sys.executable` from now on run a script.

    Args:
        patch: undoes it.
        folder: gets the files.
        script: Python code; `sys.argv[1:]` are the words after the program.
    """
    code, program = folder / "instead.py", folder / "python"
    code.write_text(script)
    program.write_text(f'#!/bin/sh\nexec {shlex.join([sys.executable, str(code)])} "$@"\n')
    program.chmod(0o755)
    patch.setattr(sys, "executable", str(program))
