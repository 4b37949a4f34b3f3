"""The script that trains on several machines, with two nodes on this one."""

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
SCRIPT = ROOT / "examples" / "train_on_machines.sh"


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def test_what_is_missing_is_named() -> None:
    done = subprocess.run(
        [str(SCRIPT), "data"],
        env={"PATH": os.environ["PATH"]},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert "MASTER: is not set: expected the address of one of the machines" in done.stderr


@pytest.mark.slow
def test_two_nodes_train_together(write_dataset: Callable[..., Path], tmp_path: Path) -> None:
    pytest.importorskip("torch")
    from perceptree.models import load_checkpoint

    data, out = write_dataset(train=10, val=2), tmp_path / "run"
    env = {
        **os.environ,
        "MASTER": "127.0.0.1",
        "NODES": "2",
        "PORT": str(free_port()),
        "PYTHON": sys.executable,
        "PYTHONPATH": str(ROOT),
        "OMP_NUM_THREADS": "1",
    }
    words = ("--modality", "depth", "--steps", 4, "--batch", 4, "--width", 128, "--height", 64)
    words = (*words, "--workers", 0, "--device", "cpu", "--precision", "fp32", "--out", out)
    nodes = [
        subprocess.Popen(
            [str(SCRIPT), str(data), *map(str, words)],
            env=env,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for _ in range(2)
    ]
    told = [node.communicate(timeout=300)[0] for node in nodes]
    assert [node.returncode for node in nodes] == [0, 0], told
    # Only the process of rank 0 says where the run is.
    assert sum(str(out) in text for text in told) == 1
    assert load_checkpoint(out / "best.safetensors")[0].spec.modality == "depth"
