"""Locks between processes."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import pytest

from basetree.errors import InputFileError
from basetree.files.locking import locked

_HOLD = """
import sys, time
from pathlib import Path
from basetree.files.locking import locked

with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_process_that_is_killed_frees_its_lock(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    holder = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(file)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(InputFileError, match="another process holds"), locked(file, 0.1):
            pass
    finally:
        holder.kill()
        holder.communicate()
    with locked(file, 0.1):
        pass


def test_threads_take_turns(tmp_path: Path) -> None:
    file = tmp_path / "count"
    file.write_text("0")

    def count() -> None:
        for _ in range(50):
            with locked(file):
                file.write_text(str(int(file.read_text()) + 1))

    threads = [threading.Thread(target=count) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert file.read_text() == "200"


def test_a_folder_that_is_missing_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="cannot be locked"), locked(tmp_path / "no" / "a"):
        pass
