"""Files appear whole, follow no planted links, and leave nothing behind."""

from __future__ import annotations

import errno
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

import calib
from basetree.files.writing import remove_leftovers, replacing, replacing_folder, write_whole

posix = pytest.mark.skipif(sys.platform == "win32", reason="POSIX only")

# Holds a file open, with its content written, until it is told to go on.
WRITER = """
import sys
from pathlib import Path
from basetree.files.writing import replacing
with replacing(Path(sys.argv[1])) as file:
    file.write(b"new")
    file.flush()
    print("written", flush=True)
    input()
"""
FULL = """
import resource, sys
from pathlib import Path
from basetree.errors import InputFileError
from basetree.files import writing
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    writing.write_whole(Path(sys.argv[1]), bytes(5000))
except InputFileError as error:
    print(error)
"""


def writer(path: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "written\n"
    return process


def hidden(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if path.name.startswith(".calib-")]


@posix
def test_a_planted_link_is_not_followed(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("mine")
    for name in ("camera.json.part", "camera.json"):
        (tmp_path / name).symlink_to(victim)
    camera = calib.PinholeCamera(640, 360, 400.0, 400.0, 319.5, 179.5)
    calib.save_camera(tmp_path / "camera.json", camera)
    assert victim.read_text() == "mine"
    assert (tmp_path / "camera.json.part").is_symlink()
    assert not (tmp_path / "camera.json").is_symlink(), "the link is replaced"
    assert calib.load_camera(tmp_path / "camera.json") == camera


@posix
@pytest.mark.parametrize("mask", [0o022, 0o077])
def test_permissions_are_those_of_new_files(tmp_path: Path, mask: int) -> None:
    before = os.umask(mask)
    try:
        write_whole(tmp_path / "file", b"x")
    finally:
        os.umask(before)
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o666 & ~mask


def test_the_content_is_on_the_disk_before_the_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, steps = tmp_path / "file", []
    sync, rename = os.fsync, Path.replace

    def synced(descriptor: int) -> None:
        is_folder = os.path.samestat(os.fstat(descriptor), tmp_path.stat())
        steps.append("folder" if is_folder else f"file of {os.fstat(descriptor).st_size}")
        sync(descriptor)

    def renamed(old: Path, new: Path) -> Path:
        steps.append("rename")
        return rename(old, new)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(Path, "replace", renamed)
    write_whole(path, b"whole")
    assert steps[:2] == ["file of 5", "rename"]
    assert steps[2:] == ([] if sys.platform == "win32" else ["folder"])


@posix
def test_leftovers_of_killed_processes_are_removed_and_those_of_live_ones_kept(
    tmp_path: Path,
) -> None:
    killed, live = writer(tmp_path / "killed"), writer(tmp_path / "live")
    killed.kill()
    killed.wait()
    assert len(hidden(tmp_path)) == 2
    others = [tmp_path / ".calib-mine.part", tmp_path / "film.mkv.part"]
    for path in others:
        path.write_text("not a leftover")
    (tmp_path / ".calib-0123456789abcdef.part").symlink_to(others[0])
    remove_leftovers(tmp_path)
    left = [path for path in hidden(tmp_path) if path.is_file() and not path.is_symlink()]
    assert len(left) == 2, "the live one's and the one with another name"
    assert all(path.exists() for path in others)
    live.communicate("\n")
    assert (tmp_path / "live").read_bytes() == b"new"
    assert not (tmp_path / "killed").exists()


@posix
def test_the_next_process_that_writes_to_a_folder_cleans_it(tmp_path: Path) -> None:
    killed = writer(tmp_path / "file")
    killed.kill()
    killed.wait()
    assert hidden(tmp_path)
    writer(tmp_path / "file").communicate("\n")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@posix
def test_a_file_is_not_lost_to_processes_that_clean_at_the_same_time(tmp_path: Path) -> None:
    code = (
        "import sys, time\nfrom pathlib import Path\n"
        "from basetree.files.writing import remove_leftovers\n"
        "print('go', flush=True)\n"
        "while True:\n    remove_leftovers(Path(sys.argv[1]))\n"
    )
    cleaner = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert cleaner.stdout is not None
    cleaner.stdout.readline()
    try:
        end_s = time.monotonic() + 1.0
        while time.monotonic() < end_s:
            write_whole(tmp_path / "file", b"whole")
            with replacing_folder(tmp_path / "folder") as folder:
                (folder / "x").write_text("whole")
    finally:
        cleaner.kill()
        cleaner.communicate()
    assert (tmp_path / "file").read_bytes() == b"whole"
    assert (tmp_path / "folder" / "x").read_text() == "whole"


@posix
def test_a_full_disk_is_one_line_and_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(path)], capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == (f"{path}: cannot be written (File too large)\n", "")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@posix
def test_only_regular_files_are_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path):
        with pytest.raises(OSError, match=re.escape(str(path))) as caught, replacing(path):
            pass
        assert (caught.value.strerror, caught.value.filename) == ("not a regular file", str(path))
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]


def test_a_folder_appears_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "cache"
    path.mkdir()
    (path / "old").touch()

    def fill(*, fails: bool) -> None:
        with replacing_folder(path) as folder:
            (folder / "new").touch()
            assert (path / "old").exists()
            if fails:
                raise RuntimeError

    with pytest.raises(RuntimeError):
        fill(fails=True)
    assert [found.name for found in path.iterdir()] == ["old"]
    fill(fails=False)
    assert [found.name for found in path.iterdir()] == ["new"]
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("place", [".", "inner/.."])
def test_a_folder_that_cannot_be_replaced_is_kept(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "old").touch()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OSError, match="current folder"), replacing_folder(Path(place)) as folder:
        (folder / "new").touch()
    assert sorted(found.name for found in tmp_path.iterdir()) == ["inner", "old"]


def test_a_folder_is_kept_if_the_new_one_cannot_take_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "kit"
    path.mkdir()
    (path / "old").touch()

    def fail(*_: object) -> None:
        raise OSError(errno.EIO, "no luck")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OSError, match="no luck"), replacing_folder(path) as folder:
        (folder / "new").touch()
    assert [found.name for found in path.iterdir()] == ["old"]
    assert list(tmp_path.iterdir()) == [path]
