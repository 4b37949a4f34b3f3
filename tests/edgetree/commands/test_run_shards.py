"""`edgetree run --shard` and `edgetree merge`: row for row the results of one machine."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from edgetree.results.csv_table import PROFILES
from edgetree.shards import inputs, work

Cli = Callable[..., Any]


@pytest.fixture
def frames(images: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of seven images with depth, two with the same stem, in blocks of two."""
    monkeypatch.setattr(work, "BLOCK_FRAMES", 2)
    for stem in "cdefg":
        shutil.copy(images / "a.jpg", images / f"{stem}.jpg")
        shutil.copy(images.parent / "depth" / "a.png", images.parent / "depth" / f"{stem}.png")
    cv2.imwrite(str(images / "a.png"), np.zeros((360, 640, 3), np.uint8))
    return images


def options(frames: Path, model: Path) -> tuple[object, ...]:
    folder = frames.parent
    cameras = ("--camera", folder / "camera.json", "--depth", folder / "depth")
    return (frames, "--model", model, *cameras, "--stump-height", 0.5)


def rows(path: Path) -> list[dict[str, Any]]:
    """The JSON lines without what differs from run to run."""
    records = [json.loads(line) for line in path.read_text().splitlines()]
    return [{k: v for k, v in record.items() if k != "detect_ms"} for record in records]


def files(folder: Path) -> tuple[object, ...]:
    folder.mkdir()
    return tuple(
        part for name in ("jsonl", "csv", "profiles") for part in (f"--{name}", folder / name)
    )


@pytest.mark.parametrize("command", ["run", "measure"])
def test_shards_make_the_rows_of_one_machine(
    run_cli: Cli, frames: Path, model: Path, tmp_path: Path, command: str
) -> None:
    given = options(frames, model)
    assert run_cli("run", *given, *files(tmp_path / "whole")).code == 0
    for number in (3, 1, 2):
        shard = ("--shards", tmp_path / "parts", "--shard", f"{number}/3")
        done = run_cli(command, *given, *shard)
        assert (done.code, done.out) == (0, "")
    done = run_cli("merge", tmp_path / "parts", *files(tmp_path / "merged"))
    assert (done.code, done.out) == (0, "")
    assert rows(tmp_path / "merged" / "jsonl") == rows(tmp_path / "whole" / "jsonl")
    assert len(rows(tmp_path / "merged" / "jsonl")) == 8
    for name in ("csv", "profiles"):
        assert (tmp_path / "merged" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    assert (tmp_path / "merged" / "profiles").read_text().startswith(",".join(PROFILES.columns))


def test_frames_at_a_url_give_the_same_rows_with_its_name(
    run_cli: Cli, frames: Path, model: Path, tmp_path: Path
) -> None:
    pytest.importorskip("fsspec")
    from basetree.jobs import copy_folder, open_store

    copy_folder(frames, open_store("memory://camp/images"))
    copy_folder(frames.parent / "depth", open_store("memory://camp/depth"))
    (_, *others) = options(frames, model)
    others[others.index("--depth") + 1] = "memory://camp/depth"
    run_cli("run", *options(frames, model), *files(tmp_path / "whole"))
    parts = ("--shards", "memory://camp/parts")
    done = run_cli("run", "memory://camp/images", *others, *parts, *files(tmp_path / "merged"))
    assert (done.code, done.out) == (0, "")
    found = rows(tmp_path / "merged" / "jsonl")
    assert found[0]["path"] == "memory://camp/images/a.jpg"
    expected = rows(tmp_path / "whole" / "jsonl")
    assert [{**row, "path": ""} for row in found] == [{**row, "path": ""} for row in expected]
    assert (tmp_path / "merged" / "csv").read_bytes() == (tmp_path / "whole" / "csv").read_bytes()


def test_a_broken_frame_is_left_out_of_the_merged_results(
    run_cli: Cli, frames: Path, model: Path, tmp_path: Path
) -> None:
    (frames / "d.jpg").write_text("no image")
    parts = tmp_path / "parts"
    assert run_cli("run", *options(frames, model), "--shards", parts, "--shard", "1/1").code == 0
    done = run_cli("merge", parts, "--json")
    assert done.code == 1
    assert json.loads(done.out)["frames"] == 7
    (reason,) = json.loads(done.out)["left_out"]
    assert reason.startswith(f"image {frames / 'd.jpg'} cannot be read")
    assert done.err.splitlines()[0] == f"left out: {reason}"
    assert done.err.splitlines()[-1].endswith("1 of 8 frames left out, see above")


def test_merged_lines_go_to_stdout(run_cli: Cli, frames: Path, model: Path, tmp_path: Path) -> None:
    done = run_cli("run", *options(frames, model), "--shards", tmp_path / "parts")
    assert done.code == 0
    names = [json.loads(line)["frame"] for line in done.out.splitlines()]
    assert names == ["a.jpg", "a.png", "b", "c", "d", "e", "f", "g"]
    assert "detecting: 8 of 8 frames" in done.err


def test_recordings_are_done_one_by_one(run_cli: Cli, model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    for name in ("one", "two"):
        size = (64, 48)
        writer = cv2.VideoWriter(
            str(folder / f"{name}.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, size
        )
        for level in (0, 100, 200):
            writer.write(np.full((48, 64, 3), level, np.uint8))
        writer.release()
    (folder / "notes.txt").write_text("no recording")
    for text in ("1/2", "2/2"):
        parts = ("--shards", tmp_path / "parts", "--shard", text)
        assert run_cli("run", folder, "--model", model, *parts).code == 0
    done = run_cli("merge", tmp_path / "parts")
    whole = [
        line
        for name in ("one", "two")
        for line in run_cli("run", folder / f"{name}.avi", "--model", model).out.splitlines()
    ]
    found = [{**json.loads(line), "detect_ms": 0} for line in done.out.splitlines()]
    assert found == [{**json.loads(line), "detect_ms": 0} for line in whole]
    assert len(found) == 6


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("--shard", "1/2"), "--shard given without --shards: expected the folder or URL"),
        (("--ray", "local"), "--ray given without --shards"),
        (("--shards", "p", "--shard", "1/2", "--ray", "local"), "--shard given with --ray"),
        (
            ("--shards", "p", "--shard", "1/2", "--csv", "t.csv"),
            "expected it with `edgetree merge`",
        ),
        (
            ("--shards", "p", "--out", "pictures"),
            "--out given with --shards: expected --csv, --jso",
        ),
        (("--shards", "p", "--shard", "3/2"), "--shard is '3/2'"),
        (("--shards", "p", "--strict-frames"), "--strict-frames given with --shards"),
        (("--shards", "gopher://p"), "unknown kind of store 'gopher'"),
    ],
)
def test_wrong_options_are_one_line(
    run_cli: Cli, frames: Path, model: Path, given: tuple[str, ...], message: str
) -> None:
    done = run_cli("run", *options(frames, model), *given)
    assert (done.code, done.out) == (2, "")
    assert message in done.err
    assert len(done.err.splitlines()) == 1


def test_other_frames_of_the_same_names_are_another_job(
    run_cli: Cli, frames: Path, model: Path, tmp_path: Path
) -> None:
    given = (*options(frames, model), "--shards", tmp_path / "parts")
    assert run_cli("run", *given).code == 0
    picture = cv2.imread(str(frames / "c.jpg"))
    cv2.imwrite(str(frames / "c.jpg"), picture[:, ::-1])
    done = run_cli("run", *given)
    assert done.code == 2
    assert "holds parts of another job" in done.err


def test_another_camera_of_the_same_file_is_another_job(
    run_cli: Cli, frames: Path, model: Path, tmp_path: Path
) -> None:
    cameras = tmp_path / "chain.yaml"
    lines = (
        "cam{0}:",
        "  camera_model: pinhole",
        "  distortion_model: none",
        "  distortion_coeffs: []",
        "  intrinsics: [{1}, {1}, 320, 180]",
        "  resolution: [640, 360]",
        "",
    )
    each = "\n".join(lines)
    cameras.write_text(each.format(0, 350) + each.format(1, 600))
    source, *others = options(frames, model)
    place = others.index("--camera") + 1
    shards = ("--shards", tmp_path / "parts")
    others[place] = f"{cameras}:cam0"
    assert run_cli("run", source, *others, *shards).code == 0
    others[place] = f"{cameras}:cam1"
    done = run_cli("run", source, *others, *shards)
    assert done.code == 2
    assert "holds parts of another job" in done.err


def test_other_options_are_another_job(
    run_cli: Cli, frames: Path, model: Path, tmp_path: Path
) -> None:
    given = (*options(frames, model), "--shards", tmp_path / "parts", "--shard", "1/2")
    assert run_cli("run", *given).code == 0
    lower = tuple(0.4 if value == 0.5 else value for value in given)
    for other in ((*given, "--score-threshold", 0.1), lower):
        done = run_cli("run", *other)
        assert done.code == 2
        assert "holds parts of another job" in done.err
    done = run_cli("measure", *given, "--mask", frames / "a.png")
    assert done.code == 2
    assert "--mask given with --shards: expected a model" in done.err


def test_missing_inputs_are_one_line(
    run_cli: Cli, frames: Path, model: Path, tmp_path: Path
) -> None:
    (tmp_path / "none").mkdir()
    parts = ("--shards", tmp_path / "parts")
    done = run_cli("run", tmp_path / "none", "--model", model, *parts)
    assert done.code == 2
    assert "has no images and no recordings" in done.err
    for path in (frames.parent / "depth").iterdir():
        path.unlink()
    done = run_cli("run", *options(frames, model), *parts)
    assert done.code == 2
    assert "a.png does not exist, nor with .tif, .tiff, .npy: expected one for image" in done.err


def test_a_worker_that_sees_other_files_is_refused(frames: Path) -> None:
    before = inputs.list_frames(frames, None).digest
    (frames / "new.jpg").write_bytes(b"")
    assert inputs.list_frames(frames, None).digest != before
