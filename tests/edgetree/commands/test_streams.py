"""Full disks, and streams that are closed or full: nothing is half, and other outputs go on."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")

MAIN = "from edgetree.cli import main; main()"
FULL = "edgetree: standard output: No space left on device\n"


def edgetree(
    *arguments: object,
    stdout: str | int = subprocess.PIPE,
    stderr: str | int = subprocess.PIPE,
    start: Callable[[], None] | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own; streams may be paths."""
    with ExitStack() as stack:
        streams = [
            stack.enter_context(open(name, "w")) if isinstance(name, str) else name
            for name in (stdout, stderr)
        ]
        return subprocess.run(
            [sys.executable, "-c", MAIN, *map(str, arguments)],
            stdout=streams[0],
            stderr=streams[1],
            preexec_fn=start,
            text=True,
            check=False,
        )


@pytest.fixture
def metres(images: Path) -> tuple[object, ...]:
    """The options to measure image a."""
    folder = images.parent
    files = ("--depth", folder / "depth" / "a.png", "--camera", folder / "camera.json")
    return (*files, "--rig-errors", "scale=0,principal=0,vertical=0,mounting=0")


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_stdout_is_one_line(
    images: Path,
    model: Path,
    metres: tuple[object, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    unbuffered: str,
) -> None:
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)
    image = images / "a.jpg"
    for arguments in (
        ("run", images, "--model", model),
        ("run", images, "--model", model, "--json"),
        ("measure", image, *metres, "--model", model),
        ("--version",),
    ):
        done = edgetree(*arguments, stdout="/dev/full")
        assert done.returncode == 2, arguments
        assert done.stderr.endswith(FULL), done.stderr
        assert "Traceback" not in done.stderr
        assert "Exception" not in done.stderr


@pytest.mark.parametrize("command", ["run", "live"])
def test_beside_a_full_stdout_the_table_is_written(
    images: Path, model: Path, metres: tuple[object, ...], tmp_path: Path, command: str
) -> None:
    csv = tmp_path / "trees.csv"
    options = (*metres, "--model", model, "--csv", csv)
    done = edgetree(command, images / "a.jpg", *options, stdout="/dev/full")
    assert done.returncode == 1, done.stderr
    first, *_, last = done.stderr.splitlines()
    assert first == (
        "standard output: No space left on device: it is given up, and the other outputs go on"
    )
    assert last == ("edgetree: standard output lacks 1 of 1 frame (No space left on device)")
    assert len(csv.read_text().splitlines()) == 2
    assert not list(tmp_path.glob(".*"))


def test_beside_a_reader_that_ends_the_table_is_written(
    images: Path, model: Path, tmp_path: Path
) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    csv = tmp_path / "trees.csv"
    done = edgetree("run", images, "--model", model, "--csv", csv, stdout=writer)
    os.close(writer)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("edgetree: standard output lacks 2 of 2 frame")
    assert len(csv.read_text().splitlines()) == 3


def test_a_closed_stdout_is_one_line(images: Path, model: Path) -> None:
    done = edgetree("run", images, "--model", model, start=lambda: os.close(1))
    assert done.returncode == 2
    assert done.stderr == (
        "edgetree: standard output is closed: expected a terminal, a file or /dev/null\n"
    )


def test_a_closed_or_full_stderr_loses_no_results(images: Path, model: Path) -> None:
    expected = edgetree("run", images / "a.jpg", "--model", model)
    closed = edgetree("run", images / "a.jpg", "--model", model, start=lambda: os.close(2))
    full = edgetree("run", images / "a.jpg", "--model", model, stderr="/dev/full")
    for done in (closed, full):
        assert done.returncode == 0
        assert done.stdout.partition("detect_ms")[0] == expected.stdout.partition("detect_ms")[0]


def test_a_reader_that_ends_is_no_error() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = edgetree("--version", stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.parametrize("option", ["--csv", "--jsonl", "--coco", "--report", "--out"])
def test_a_full_disk_leaves_nothing_and_the_other_outputs_go_on(
    images: Path, model: Path, tmp_path: Path, option: str
) -> None:
    out = tmp_path / "new" / ("trees.html" if option == "--report" else "trees")
    if option != "--out":
        out.parent.mkdir()
    before = sorted(tmp_path.rglob("*"))

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))

    done = edgetree("run", images, "--model", model, option, out, start=limit)
    assert sorted(tmp_path.rglob("*")) == before
    *_, last = done.stderr.splitlines()
    if option == "--jsonl":  # no other output
        assert (done.returncode, done.stderr) == (2, f"{last}\n")
        assert last.startswith(f"edgetree: {out} cannot be written (File too large)")
        return
    assert done.returncode == 1, done.stderr
    lacks = "lacks 2 of 2 frames" if option == "--out" else "is not written"
    assert last == f"edgetree: {option} {out} {lacks} (File too large)"
    assert len(done.stdout.splitlines()) == 2
