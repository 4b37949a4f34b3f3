"""`edgetree run` and `calibrate` on several files, patterns and folders below folders."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from edgetree.commands import run_results
from edgetree.commands.frame_results import LeftOut
from edgetree.frames.frame import Frame
from edgetree.measure import StemViews
from edgetree.sources.source import BaseSource

Cli = Callable[..., Any]


@pytest.fixture
def plots(images: Path) -> Path:
    """Two folders of pictures of the same names below one."""
    root = images.parent / "plots"
    for plot in ("north", "south"):
        shutil.copytree(images, root / plot)
    return root


def test_files_a_quoted_pattern_and_folders_below_give_the_same_frames(
    run_cli: Cli, model: Path, plots: Path
) -> None:
    files = sorted(plots.glob("*/*.jpg"))
    expected = ["north_a", "north_b", "south_a", "south_b"]
    for typed in (files, [plots / "*" / "*.jpg"], [plots, "--recursive"]):
        done = run_cli("run", *typed, "--model", model)
        assert done.code == 0, done.err
        assert [json.loads(line)["frame"] for line in done.out.splitlines()] == expected


def test_outputs_tell_pictures_of_the_same_name_apart(
    run_cli: Cli, model: Path, plots: Path, tmp_path: Path
) -> None:
    options = ("--out", tmp_path / "drawn", "--coco", tmp_path / "labels.json", "--json")
    done = run_cli("run", plots, "--recursive", "--model", model, *options)
    assert done.code == 0, done.err
    drawn = {path.name for path in (tmp_path / "drawn").iterdir()}
    assert drawn == {f"{plot}_{stem}_trees.jpg" for plot in ("north", "south") for stem in "ab"}
    labels = json.loads((tmp_path / "labels.json").read_text())
    files = [image["file_name"] for image in labels["images"]]
    assert files == ["north/a.jpg", "north/b.jpg", "south/a.jpg", "south/b.jpg"]
    assert json.loads(done.out)["sources"] == [str(plots / plot) for plot in ("north", "south")]


def test_the_next_command_that_is_named_runs_on_the_same(
    run_cli: Cli, model: Path, plots: Path
) -> None:
    done = run_cli("run", plots / "*", "--model", model)
    assert f"next: edgetree run '{plots}/*' --model" in done.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--right", "x.jpg"), "--right given with 2 sources: expected one source"),
        (("--shards", "parts"), "--shards given with 2 sources: expected one source"),
        (("--csv", "north/a.jpg"), "which is a file of source 1"),
    ],
)
def test_what_is_for_one_source_is_refused(
    run_cli: Cli,
    model: Path,
    plots: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(plots)
    done = run_cli("run", "north", "south", "--model", model, *options)
    assert done.code == 2
    assert message in done.err


def test_calibrate_takes_a_pattern(run_cli: Cli, images: Path, tmp_path: Path) -> None:
    out = tmp_path / "found.json"
    done = run_cli("calibrate", images / "*.jpg", "--board", "checkerboard:9x6:0.025", "--out", out)
    assert "0 of 2 pictures show the board" in done.out


class _Frames(BaseSource):
    """A frame of each of some files."""

    def __init__(self, files: list[str]) -> None:
        super().__init__("all")
        self._files = files

    def __iter__(self) -> Iterator[Frame]:
        for number, file in enumerate(self._files):
            yield Frame(str(number), Path(file), None, number=number)


@pytest.mark.parametrize(
    "files",
    [
        ["first.mcap", "first.mcap", "second.mcap", "second.mcap"],
        ["drive/RGB/0.jpg", "drive/RGB/1.jpg", "other/RGB/0.jpg", "other/RGB/1.jpg"],
    ],
)
def test_stems_of_one_recording_are_not_triangulated_in_the_next(
    monkeypatch: pytest.MonkeyPatch, files: list[str]
) -> None:
    """Each recording has poses in a frame of its own."""
    seen: list[tuple[Path | None, StemViews]] = []

    def process(frame: Frame, *given: Any) -> Frame:
        seen.append((frame.path, given[-1]))
        return frame

    monkeypatch.setattr(run_results, "process", process)
    unused: Any = SimpleNamespace(stems=None, look=lambda *_: None)
    given = [*[unused] * 7, LeftOut(strict=True), unused, unused]
    results = run_results.RunResults(*given)
    assert len(list(results.of(_Frames(files), shown=False))) == 4
    (_, first), (_, still_first), (_, second), (_, still_second) = seen
    assert first is still_first
    assert second is still_second
    assert first is not second
