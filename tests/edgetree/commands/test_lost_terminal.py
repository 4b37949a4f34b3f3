"""A terminal that closes while a command shows its progress: the results so far are kept."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import signal
import sys
import time
from pathlib import Path

import pytest

MAIN = "from edgetree.cli import main; main()"
PATIENCE_S = 60.0

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such terminals")


def test_a_closed_terminal_keeps_the_results_so_far(
    images: Path, model: Path, tmp_path: Path
) -> None:
    import pty

    for copy in range(200):
        (images / f"c{copy}.jpg").write_bytes((images / "a.jpg").read_bytes())
    table, lines, out = (tmp_path / name for name in ("a.csv", "a.jsonl", "out"))
    options = ("--csv", table, "--jsonl", lines, "--out", out)
    command = [sys.executable, "-c", MAIN, "run", images, "--model", model, *options]
    child, terminal = pty.fork()
    if not child:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # which `nohup` ignores for all below it
        os.execv(sys.executable, list(map(str, command)))
    end_s = time.monotonic() + PATIENCE_S
    while not (out.is_dir() and len(list(out.glob("*.jpg"))) > 3):
        os.set_blocking(terminal, False)
        with contextlib.suppress(BlockingIOError):
            os.read(terminal, 65536)
        assert time.monotonic() < end_s
        time.sleep(0.01)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 129
    names = [json.loads(line)["frame"] for line in lines.read_text().splitlines()]
    with table.open(newline="") as stream:
        assert [row["frame"] for row in csv.DictReader(stream)] == names
    assert 3 < len(names) < 202
    assert not list(tmp_path.glob(".*"))
