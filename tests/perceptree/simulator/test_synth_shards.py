"""``perceptree synth --shard`` and ``perceptree merge``: byte for byte the data of one machine."""

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

Result = tuple[int, str, str]
Call = Callable[..., Result]
OPTIONS = ("--frames", 9, "--seed", 4, "--width", 128, "--height", 72, "--views", 2)


@pytest.fixture
def call(in_process: None, call: Call) -> Call:
    """Run ``perceptree ARGUMENTS`` with fake frames."""
    return call


@pytest.fixture
def whole(call: Call, tmp_path: Path, synth: ModuleType) -> dict[str, bytes]:
    """The files that one machine makes."""
    assert call("synth", "--out", tmp_path / "whole", *OPTIONS)[0] == 0
    return synth.contents(tmp_path / "whole")


def shards(call: Call, out: Path, *texts: str) -> None:
    for text in texts:
        code, _, told = call("synth", "--out", out, *OPTIONS, "--shard", text)
        assert code == 0, told


def without_manifests(files: dict[str, bytes]) -> dict[str, bytes]:
    return {name: data for name, data in files.items() if not name.startswith("shards/")}


def test_shards_in_one_folder_are_merged_there(
    call: Call, tmp_path: Path, whole: dict[str, bytes], synth: ModuleType
) -> None:
    shards(call, tmp_path / "out", "1/3", "3/3")
    code, _, told = call("merge", tmp_path / "out")
    assert code == 2
    assert "2 of 5 parts are missing; run the shard 2/3 to the end, and merge again" in told
    shards(call, tmp_path / "out", "2/3")
    code, printed, _ = call("merge", tmp_path / "out")
    assert code == 0
    assert printed.splitlines()[0] == "train: 5 frames, 7 trees"
    assert without_manifests(synth.contents(tmp_path / "out")) == whole


def test_shards_of_two_places_are_merged_into_a_third_again_and_again(
    call: Call, tmp_path: Path, whole: dict[str, bytes], synth: ModuleType
) -> None:
    shards(call, tmp_path / "a", "1/2")
    shards(call, tmp_path / "b", "2/2")
    for _ in range(2):
        code, _, told = call("merge", tmp_path / "a", tmp_path / "b", "--out", tmp_path / "out")
        assert (code, told) == (0, "")
        assert synth.contents(tmp_path / "out") == whole
    (tmp_path / "out" / "images" / "000003.jpg").unlink()
    call("merge", tmp_path / "a", tmp_path / "b", "--out", tmp_path / "out")
    assert synth.contents(tmp_path / "out") == whole


def test_a_shard_says_where_it_is_and_what_is_next(call: Call, tmp_path: Path) -> None:
    code, printed, told = call("synth", "--out", tmp_path / "out", *OPTIONS, "--shard", "2/3")
    assert code == 0
    assert f"perceptree merge {tmp_path / 'out'}" in printed
    assert "simulating: 3 of 3 frames" in told
    assert "core-hours per 1,000 frames" in told
    code, printed, told = call(
        "synth", "--out", tmp_path / "out", *OPTIONS, "--shard", "2/3", "--json"
    )
    assert json.loads(printed)["manifest"] == "shards/000002-of-000003.json"
    assert "3 of 3 frames are finished from an earlier run" in told


def test_shards_of_fewer_frames_than_the_folder_holds_make_the_shorter_dataset(
    call: Call, tmp_path: Path, whole: dict[str, bytes], synth: ModuleType
) -> None:
    longer = ("--frames", 10, *OPTIONS[2:])
    assert call("synth", "--out", tmp_path / "out", *longer)[0] == 0
    shards(call, tmp_path / "out", "1/1")
    assert call("merge", tmp_path / "out")[0] == 0
    made = synth.contents(tmp_path / "out")
    for name in ("train_RGB.json", "val_RGB.json", "test_RGB.json", "statistics.json"):
        assert made[name] == whole[name], name


def test_a_lost_file_is_made_again(
    call: Call, tmp_path: Path, whole: dict[str, bytes], synth: ModuleType
) -> None:
    shards(call, tmp_path / "a", "1/2")
    shards(call, tmp_path / "b", "2/2")
    (tmp_path / "b" / "depth" / "000002.png").write_bytes(b"half")
    merge = ("merge", tmp_path / "a", tmp_path / "b", "--out", tmp_path / "out")
    code, _, told = call(*merge)
    assert code == 2
    assert "files of 1 scenes are missing or have another size; run the shards again" in told
    shards(call, tmp_path / "b", "2/2")
    assert call(*merge)[0] == 0
    assert synth.contents(tmp_path / "out") == whole


def test_an_object_store_without_shards_is_filled_and_completed(
    call: Call, tmp_path: Path, whole: dict[str, bytes]
) -> None:
    memory = pytest.importorskip("fsspec").filesystem("memory")
    code, printed, _ = call("synth", "--out", "memory://synth/data", *OPTIONS)
    assert code == 0
    assert "memory://synth/data/statistics.html" in printed
    found = {name.removeprefix("/synth/data/"): memory.cat(name) for name in memory.find("/synth")}
    assert without_manifests(found) == whole
    out = tmp_path / "local"
    assert call("merge", "memory://synth/data", "--out", out)[0] == 0
    assert (out / "train_RGB.json").read_bytes() == whole["train_RGB.json"]
    memory.rm("/synth", recursive=True)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--shard", "4/3"), "--shard is '4/3': expected a number and a count"),
        (("--shard", "1/3", "--ray", "local"), "--shard given with --ray: expected one of them"),
        (("--shard", "1/3", "--frames", 3), "expected at least"),
        (("--shard", "1/3", "--seed", 5), "holds parts of another job"),
        (("--preset", "test", "--shard", "1/3", "--seed", 5), "--preset test is frozen"),
    ],
)
def test_wrong_options_are_one_line(
    call: Call, tmp_path: Path, options: tuple[object, ...], message: str
) -> None:
    shards(call, tmp_path / "out", "1/3")
    code, printed, told = call("synth", "--out", tmp_path / "out", *OPTIONS, *options)
    assert (code, printed) == (2, "")
    assert message in told.splitlines()[-1]


def test_merging_what_is_no_shard_is_one_line(call: Call, tmp_path: Path) -> None:
    code, _, told = call("merge", tmp_path)
    assert code == 2
    assert told.strip().endswith("no shard is finished; expected a manifest in shards/ there")
    shards(call, tmp_path / "a", "1/2")
    shards(call, tmp_path / "b", "2/2")
    code, _, told = call("merge", tmp_path / "a", tmp_path / "b")
    assert code == 2
    assert "--out is missing: expected a folder or URL to join 2 into" in told
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "settings.json").write_text("{}")
    code, _, told = call("merge", tmp_path / "a", tmp_path / "b", "--out", tmp_path / "out")
    assert code == 2
    assert "has other settings than the shards" in told


@pytest.mark.parametrize("workers", [0, -1])
def test_a_wrong_number_of_processes_is_one_line(call: Call, tmp_path: Path, workers: int) -> None:
    code, _, told = call(
        "synth", "--out", tmp_path, *OPTIONS, "--shard", "1/2", "--workers", workers
    )
    assert code == 2
    assert f"workers is {workers}: expected 1 to 1024" in told
