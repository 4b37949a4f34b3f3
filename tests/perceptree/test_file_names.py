"""Folders whose names are not UTF-8 hold datasets, runs and predictions like others."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="names are UTF-8 on this system")

LATIN = os.fsdecode(b"caf\xe9")
SCRIPT = """
import sys
from pathlib import Path
from perceptree.cli import main
from perceptree.models import make_spec
from perceptree.training import TrainSettings, train

data, runs = map(Path, sys.argv[1:3])
spec = make_spec("edge-n", "rgb", 64, 128, fpn_width=16, box_head_width=16, masks=False,
                 keypoints=False)
plan = TrainSettings(steps=1, batch=2, warmup_steps=1, evaluate_every_steps=100)
train(spec, plan, data, Path("run"))
commands = (
    ["data", "show", data, "--out", runs / "pages"],
    ["predict", "run/best.safetensors", data / "images", "--out", runs / "drawn"],
    ["train", data, "--out", runs / "run", "--steps", 1],
)
for command in commands:
    sys.argv = ["perceptree", *map(str, command)]
    try:
        main()
    except SystemExit as done:
        print("code", done.code, flush=True)
"""


def test_a_dataset_is_trained_on_and_shown(posts: Path, tmp_path: Path) -> None:
    data, runs = posts.rename(posts.with_name(LATIN)), tmp_path / LATIN
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(data), str(runs)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    codes = [line for line in done.stdout.splitlines() if line.startswith("code")]
    assert codes == ["code 0", "code 0", "code 2"], done.stderr
    assert (runs / "pages" / "page_001.jpg").is_file()
    assert len(list((runs / "drawn").glob("*_trees.jpg"))) == len(list(data.glob("images/*")))
    expected = r"caf\udce9/run: its path is not UTF-8, which checkpoints and TensorBoard's log need"
    assert expected in done.stderr.splitlines()[-1]
