"""A process that was forked after a model was loaded answers, by its result or by one error."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

PROGRAM = """
import os, signal, sys
from edgetree import EdgetreeError, TreeDetector, default_model, sample_frames
threads, load_again = int(sys.argv[1]), sys.argv[2] == "again"
detector = TreeDetector.load(default_model("depth"), threads=threads)
depth_m = sample_frames()[0].depth_m()
expected = len(detector.detect(depth_m))
child = os.fork()
if child:
    sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
signal.alarm(60)
if load_again:
    detector = TreeDetector.load(default_model("depth"), threads=threads)
try:
    assert len(detector.detect(depth_m)) == expected
except EdgetreeError as error:
    print(error)
    sys.exit(error.exit_code)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system does not fork")
@pytest.mark.parametrize(
    ("threads", "loads", "code"), [(1, "once", 0), (2, "once", 2), (2, "again", 0), (3, "once", 2)]
)
def test_a_forked_process_answers_and_ends(threads: int, loads: str, code: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(threads), loads],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == code, (done.stderr, -done.returncode == signal.SIGALRM)
    assert done.stderr == ""
    if code:
        (line,) = done.stdout.splitlines()
        assert "forked from it without the threads of onnxruntime: expected it to be opened" in line
