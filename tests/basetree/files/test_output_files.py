"""Files are written completely or not at all; folders are checked in advance."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from basetree.errors import InputError
from basetree.files.places import check_paths
from basetree.files.writing import output_folder, replacing


def test_a_file_appears_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    with replacing(path) as file:
        file.write(b"whole")
        assert not path.exists()
        written = os.fstat(file.fileno()).st_ino
    assert path.read_text() == "whole"
    assert path.stat().st_ino == written, "renamed, not copied"
    assert list(tmp_path.iterdir()) == [path]
    (tmp_path / "plain").touch()
    assert path.stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_a_failure_keeps_the_old_file_and_leaves_no_other(
    tmp_path: Path, error: type[BaseException]
) -> None:
    path = tmp_path / "result.json"
    path.write_text("old")

    def fail() -> None:
        with replacing(path) as file:
            file.write(b"half")
            raise error

    with pytest.raises(error):
        fail()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_cannot_be_created_is_named(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with (
        pytest.raises(InputError, match=r"file/x\.json cannot be written \(.+\): expected a file"),
        replacing(file / "x.json"),
    ):
        pass
    with pytest.raises(InputError, match="is a folder: expected"), replacing(tmp_path):
        pass


def test_outputs_overwrite_no_inputs_and_no_other_outputs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "images").mkdir()
    for name in ("images/a.JPG", "images/trees.csv", "camera.json"):
        (tmp_path / name).touch()
    inputs = {"SOURCE": Path("images"), "--camera": Path("camera.json"), "--mask": None}

    def refused(**paths: str) -> str:
        with pytest.raises(InputError) as caught:
            check_paths({f"--{name}": Path(path) for name, path in paths.items()}, inputs)
        return str(caught.value)

    same = refused(out="x", csv="images/../x")
    assert same == "--csv is images/../x, which is --out x too: expected another path"
    assert "which is --camera camera.json too" in refused(csv=str(tmp_path / "camera.json"))
    assert "which is a file of SOURCE images too" in refused(csv="images/a.JPG")
    assert "which is SOURCE images too" in refused(out="images")
    check_paths({"--csv": Path("images/trees.csv"), "--out": Path("new"), "--jsonl": None}, inputs)


def test_a_folder_is_created_with_its_parents(tmp_path: Path) -> None:
    with output_folder(tmp_path / "a" / "b") as folder:
        (folder / "x").touch()
    assert (tmp_path / "a" / "b" / "x").exists()


def test_a_folder_that_cannot_be_created_is_named(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    message = r"output folder .*file.* cannot be written \(.+\): expected a writable folder"
    for folder in (file, file / "deeper"):
        with pytest.raises(InputError, match=message), output_folder(folder):
            pass
    assert list(tmp_path.iterdir()) == [file]


def test_a_failure_removes_only_empty_new_folders(tmp_path: Path) -> None:
    def fail(folder: Path, *, write: bool) -> None:
        with output_folder(folder):
            if write:
                (folder / "kept").touch()
            raise RuntimeError

    (tmp_path / "old").mkdir()
    with pytest.raises(RuntimeError):
        fail(tmp_path / "old" / "new" / "newer", write=False)
    assert list((tmp_path / "old").iterdir()) == []
    with pytest.raises(RuntimeError):
        fail(tmp_path / "new", write=True)
    assert (tmp_path / "new" / "kept").exists()
