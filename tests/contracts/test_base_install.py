"""The run of the runtime's tests without torch cannot pass by running nothing."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

CI = Path(__file__).resolve().parents[2] / ".ci"
PLUGIN = runpy.run_path(str(CI / "base_install.py"))
ENOUGH = PLUGIN["FEWEST_PASSED"]
FOR_TORCH = "tests/x.py: Skipped: could not import 'perceptree.data': No module named 'torch'"


FOR_DATA = "tests/x.py: Skipped: the folder shared is not beside the checkout"


def test_a_good_run_has_no_complaints() -> None:
    skips = [FOR_TORCH, FOR_TORCH, FOR_DATA, FOR_TORCH.replace("torch", "cryptography")]
    assert PLUGIN["complaints"]([], skips, ENOUGH) == []


@pytest.mark.parametrize(
    ("installed", "skips", "passed", "expected"),
    [
        (["torch"], [], ENOUGH, "torch is installed"),
        ([], [], ENOUGH - 1, f"{ENOUGH - 1} tests passed: expected {ENOUGH}"),
        ([], ["tests/x.py: Skipped: no sound card"], ENOUGH, "no sound card"),
        (
            [],
            ["tests/x.py: Skipped: could not import 'cv2': No module named 'cv2'"],
            ENOUGH,
            "not for an extra",
        ),
    ],
)
def test_what_is_wrong_is_said(
    installed: list[str], skips: list[str], passed: int, expected: str
) -> None:
    (complaint,) = PLUGIN["complaints"](installed, skips, passed)
    assert expected in complaint


def test_every_package_that_a_test_may_miss_is_listed() -> None:
    folders = [CI.parent / "tests" / name for name in ("basetree", "calib", "edgetree")]
    needed = {
        module
        for folder in folders
        for file in folder.rglob("*.py")
        for module in re.findall(r'importorskip\(\s*"(\w+)', file.read_text())
    }
    assert "rosbags" in needed
    assert needed - set(sys.stdlib_module_names) <= set(PLUGIN["ABSENT"])


def test_a_run_with_complaints_fails(tmp_path: Path) -> None:
    (tmp_path / "test_one.py").write_text("def test_one():\n    pass\n")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "base_install", str(tmp_path), "-c", os.devnull],
        env=os.environ | {"PYTHONPATH": str(CI)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "1 passed" in done.stdout
    assert f"base install: 1 tests passed: expected {ENOUGH} or more" in done.stdout
    assert done.returncode == 1
