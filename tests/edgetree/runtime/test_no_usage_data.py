"""onnxruntime collects no usage data in edgetree's processes."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]


def test_onnxruntime_leaves_nothing_in_the_home_folder(tmp_path: Path) -> None:
    """It would keep an id of the device there, and what it has still to send."""
    code = "from edgetree import *; TreeDetector.load(default_model('rgb'), threads=1)"
    subprocess.run(
        [sys.executable, "-c", code],
        env={"HOME": str(tmp_path), "PYTHONPATH": str(ROOT)},
        check=True,
    )
    assert list(tmp_path.rglob("*")) == []
