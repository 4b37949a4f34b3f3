"""Files and folders that grow: older ones are kept, lines are whole, links are not followed."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from file_limits import largest_file

from basetree.files import growing
from basetree.files.growing import GrowingFile, GrowingFolder, keep_older
from basetree.files.writing import UnwritableFile, is_stream, write_whole

posix = pytest.mark.skipif(sys.platform == "win32", reason="POSIX only")

# Writes a line and keeps the file open until it is told to go on.
WRITER = """
import sys
from pathlib import Path
from basetree.files.growing import GrowingFile
file = GrowingFile(Path(sys.argv[1]))
file.write("a line\\n")
file.flush()
print("written", flush=True)
input()
"""


def grown(path: Path, *lines: str) -> Path:
    with GrowingFile(path) as file:
        for line in lines:
            file.write(f"{line}\n")
            file.flush()
    return path


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("trees.csv", "trees.{}.csv"),
        ("trees", "trees.{}"),
        (".trees", ".trees.{}"),
        ("trees.v2.csv", "trees.v2.{}.csv"),
        ("trees [1]+.csv", "trees [1]+.{}.csv"),
    ],
)
def test_files_of_earlier_runs_are_kept_in_their_order(
    tmp_path: Path, name: str, kept: str
) -> None:
    for run in ("first", "second", "third"):
        grown(tmp_path / name, run)
    expected = {name: "third\n", kept.format(1): "first\n", kept.format(2): "second\n"}
    assert contents(tmp_path) == expected


def test_a_number_that_was_removed_is_not_used_again(tmp_path: Path) -> None:
    for run in ("first", "second", "third"):
        grown(tmp_path / "a.csv", run)
    (tmp_path / "a.1.csv").unlink()
    grown(tmp_path / "a.csv", "fourth")
    assert contents(tmp_path) == {"a.2.csv": "second\n", "a.3.csv": "third\n", "a.csv": "fourth\n"}


def test_an_empty_file_is_not_kept(tmp_path: Path) -> None:
    (tmp_path / "a.csv").touch()
    grown(tmp_path / "a.csv", "line")
    assert contents(tmp_path) == {"a.csv": "line\n"}


@posix
def test_a_file_that_another_process_writes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "written\n"
    with pytest.raises(UnwritableFile, match=r"a\.csv .*another process is writing it"):
        GrowingFile(path)
    assert contents(tmp_path) == {"a.csv": "a line\n"}
    process.kill()
    process.communicate()
    grown(path, "of the next process")
    assert contents(tmp_path) == {"a.1.csv": "a line\n", "a.csv": "of the next process\n"}


@posix
@pytest.mark.parametrize("target", ["victim", "nowhere", "pipe"])
def test_a_planted_link_is_moved_aside_and_not_followed(tmp_path: Path, target: str) -> None:
    (tmp_path / "victim").write_text("mine")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "shared").mkdir()
    path = tmp_path / "shared" / "a.csv"
    path.symlink_to(tmp_path / target)
    grown(path, "line")
    assert (path.read_text(), path.is_symlink()) == ("line\n", False)
    assert (tmp_path / "victim").read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()
    assert os.readlink(path.with_name("a.1.csv")) == str(tmp_path / target)


@posix
def test_a_named_pipe_is_written_as_it_is(tmp_path: Path) -> None:
    pipe, read = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    grown(pipe, "one", "two")
    reader.join(timeout=60)
    assert read == ["one\ntwo\n"]
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]


@posix
@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
@pytest.mark.parametrize("is_pipe", [True, False])
def test_a_stream_of_the_process_is_written_and_keeps_what_it_has(
    tmp_path: Path, name: str, is_pipe: bool
) -> None:
    if not Path(name).exists():
        pytest.skip(f"there is no {name}")
    assert is_stream(Path(name))  # or what follows would move the system's own link
    code = WRITER.replace("input()", "")
    (tmp_path / "out").write_text("earlier\n")
    with (tmp_path / "out").open("a") as out:
        done = subprocess.run(
            [sys.executable, "-c", code, name],
            stdout=subprocess.PIPE if is_pipe else out,
            text=True,
            check=True,
        )
    written = "a line\nwritten\n"
    assert (done.stdout if is_pipe else (tmp_path / "out").read_text()) == (
        written if is_pipe else f"earlier\n{written}"
    )
    assert os.path.lexists(name)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@posix
def test_a_stream_of_the_process_is_never_replaced(tmp_path: Path) -> None:
    with (tmp_path / "out").open("w") as out:
        path = Path(f"/dev/fd/{out.fileno()}")
        if not path.exists():
            pytest.skip("there is no /dev/fd")
        assert is_stream(path)
        with pytest.raises(Exception, match="not a regular file"):
            write_whole(path, b"new")


def test_a_line_is_written_whole_or_not_at_all_and_later_ones_go_on(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    with GrowingFile(path) as file:
        file.write("first\n")
        file.flush()
        with largest_file(10):
            file.write("second, and longer\n")
            with pytest.raises(OSError, match=r"File too large: .*a\.csv"):
                file.flush()
            assert path.read_text() == "first\n"
        file.write("third\n")
        file.flush()
    assert path.read_text() == "first\nthird\n"


def test_lines_reach_the_disk_within_the_promised_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced, sync = threading.Event(), os.fsync

    def noted(descriptor: int) -> None:
        sync(descriptor)
        if os.fstat(descriptor).st_size == len("line\n"):
            synced.set()

    monkeypatch.setattr(growing, "SYNC_EVERY_S", 0.01)
    monkeypatch.setattr(os, "fsync", noted)
    with GrowingFile(tmp_path / "a.csv") as file:
        file.write("line\n")
        file.flush()
        assert synced.wait(60)


def test_a_disk_that_did_not_keep_what_was_written_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed = threading.Event()

    def fail(descriptor: int) -> None:
        failed.set()
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with GrowingFile(tmp_path / "a.csv") as file:
        with monkeypatch.context() as patch:
            patch.setattr(growing, "SYNC_EVERY_S", 0.01)
            patch.setattr(os, "fsync", fail)
            broken = GrowingFile(tmp_path / "b.csv")
            broken.write("line\n")
            broken.flush()
            assert failed.wait(60)
            with pytest.raises(OSError, match=r"b\.csv"):
                broken.close()
        file.write("another file\n")


@posix
@pytest.mark.parametrize("removed", ["file", "folder"])
def test_a_file_that_is_removed_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, removed: str
) -> None:
    monkeypatch.setattr(growing, "SYNC_EVERY_S", 0.01)
    (tmp_path / "disk").mkdir()
    with GrowingFile(tmp_path / "disk" / "a.csv") as file:
        (tmp_path / "disk" / "a.csv").unlink()
        if removed == "folder":
            (tmp_path / "disk").rmdir()

        def write_on() -> None:
            for _ in range(1000):
                file.write("line\n")
                file.flush()
                time.sleep(0.01)

        with pytest.raises(OSError, match=r"it was removed, or its disk was: .*a\.csv"):
            write_on()


@posix
def test_a_file_that_is_emptied_by_a_log_rotation_goes_on_at_its_beginning(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    with GrowingFile(path) as file:
        for line in ("before\n", "after\n"):
            os.truncate(path, 0)
            file.write(line)
            file.flush()
    assert path.read_text() == "after\n"


def test_a_folder_has_its_name_when_it_is_complete(tmp_path: Path) -> None:
    folder = GrowingFolder(tmp_path / "bag")
    (folder.unfinished / "file").write_text("content")
    assert [path.name for path in tmp_path.iterdir()] == ["unfinished_bag"]
    with pytest.raises(UnwritableFile) as taken:
        GrowingFolder(tmp_path / "bag")
    assert taken.value.errno == errno.EEXIST
    folder.complete()
    assert (tmp_path / "bag" / "file").read_text() == "content"
    with pytest.raises(UnwritableFile) as taken:
        GrowingFolder(tmp_path / "bag")
    assert taken.value.errno == errno.EEXIST
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_a_folder_that_came_to_be_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    folder = GrowingFolder(tmp_path / "bag")
    (folder.unfinished / "file").write_text("content")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "file").write_text("of somebody else")
    with pytest.raises(UnwritableFile, match="bag"):
        folder.complete()
    assert (tmp_path / "bag" / "file").read_text() == "of somebody else"
    assert (tmp_path / "unfinished_bag" / "file").read_text() == "content"


def test_a_folder_is_kept_with_its_content(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "file").write_text("content")
    assert keep_older(tmp_path / "bag") == tmp_path / "bag.1"
    assert (tmp_path / "bag.1" / "file").read_text() == "content"
    assert keep_older(tmp_path / "bag") is None
