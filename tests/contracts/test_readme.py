"""The README's examples work: its options exist, and its Python runs."""

import json
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from edgetree.samples import sample_frames

README = (Path(__file__).resolve().parents[2] / "README.md").read_text("utf-8")


def examples(language: str) -> list[str]:
    """Contents of the fenced blocks of one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.DOTALL | re.MULTILINE)


COMMANDS = [
    line
    for block in examples("sh")
    for line in block.splitlines()
    if line.startswith(("edgetree ", "perceptree "))
]


@cache
def help_of(program: str, command: str) -> str:
    code = f"from {program}.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, command, "--help"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_there_are_examples() -> None:
    assert len(COMMANDS) >= 6
    assert len(examples("python")) == 1


@pytest.mark.parametrize("line", COMMANDS)
def test_a_commands_options_exist(line: str) -> None:
    program, command, *rest = line.partition("#")[0].split()
    text = help_of(program, command)
    options = [word for word in rest if word.startswith("--")]
    assert [option for option in options if not re.search(rf"{option}\b", text)] == []


def test_the_python_example_measures_trees(tmp_path: Path) -> None:
    frame = sample_frames()[0]
    shutil.copy(frame.depth_path, tmp_path / "frame_depth_mm.png")
    camera = {"schema": "calib.camera/1", **frame.camera.to_dict()}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    done = subprocess.run(
        [sys.executable, "-c", examples("python")[0]],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"^0\.\d{3} m, 0\.\d{3} to 0\.\d{3} m$", done.stdout, flags=re.MULTILINE)
