"""`edgetree samples` writes files that the commands it names run on."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from edgetree.sample_files import commands_for, write_samples


def run(*arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
    root = str(Path(__file__).resolve().parents[3])
    paths = os.pathsep.join((root, os.environ.get("PYTHONPATH", "")))
    return subprocess.run(
        [sys.executable, "-m", "edgetree", *map(str, arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": paths},
        check=False,
    )


def test_every_command_that_is_named_runs(tmp_path: Path) -> None:
    done = run("samples", "--out", "my samples", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    commands = commands_for(Path("my samples"))
    assert all(command in done.stderr for command in commands)
    printed = {}
    for command in commands:
        program, *arguments = shlex.split(command)
        assert program == "edgetree"
        ended = run(*arguments, folder=tmp_path)
        is_check = arguments[0] == "check"
        assert ended.returncode in ((0, 3) if is_check else (0,)), ended.stderr
        printed[arguments[0]] = ended.stdout
        if arguments[0] in ("measure", "run"):
            first, *_, following = ended.stderr.splitlines()
            assert following.startswith("next: ")
            assert (
                sum("usual errors of a camera" in line for line in ended.stderr.splitlines()) == 1
            )
            assert "usual errors" not in first
    assert "cm" in printed["measure"]
    assert "stems" in printed["check"]
    assert {"trees.csv", "trees.html", "stems.geojson"} <= {
        path.name for path in (tmp_path / "my samples").iterdir()
    }
    readme = (tmp_path / "my samples/README.txt").read_text()
    assert all(command in readme for command in commands_for(Path()))
    assert "The check ends with exit code 3" in readme


def test_a_folder_that_holds_something_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    done = run("samples", "--out", tmp_path, folder=tmp_path)
    assert done.returncode == 2
    assert "is not empty, expected a new folder" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_nothing_is_left_behind_where_nothing_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("edgetree.sample_files.write_text", refuse)
    with pytest.raises(OSError, match="no space"):
        write_samples(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
