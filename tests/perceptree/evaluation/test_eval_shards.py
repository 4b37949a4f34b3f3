"""``perceptree eval --shard`` and ``perceptree merge``: the report of one machine."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from schema_check import check_schema

from perceptree.data import read_dataset
from perceptree.evaluation import shards
from perceptree.models import TreeRCNN, make_spec, save_checkpoint

Result = tuple[int, str, str]
Call = Callable[..., Result]


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Random weights that detect trees everywhere with high scores."""
    torch.manual_seed(3)
    model = TreeRCNN(make_spec("edge-n", "rgb", 64, 96, fpn_width=32))
    with torch.no_grad():
        model.box_head.score.bias[0] += 4.0
    path = tmp_path_factory.mktemp("checkpoint") / "model.safetensors"
    save_checkpoint(path, model.eval(), {"data": "none"})
    return path


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of one batch."""
    monkeypatch.setattr(shards, "BLOCK_FRAMES", 4)


def evaluated(call: Call, *arguments: object) -> tuple[dict, str]:
    code, printed, told = call(*arguments, "--json")
    assert code == 0, told
    return json.loads(printed), told


def test_shards_make_the_report_of_one_machine(
    call: Call, checkpoint: Path, posts: Path, tmp_path: Path, small_blocks: None
) -> None:
    evaluation = ("eval", checkpoint, posts, "--split", "train")
    whole, _ = evaluated(call, *evaluation, "--out", tmp_path / "whole")
    for text in ("2/2", "1/2"):
        evaluated(call, *evaluation, "--shards", tmp_path / "parts", "--shard", text)
    merged, _ = evaluated(call, "merge", tmp_path / "parts", "--out", tmp_path / "merged")
    assert merged == whole
    for name in ("report.html", "report.json"):
        assert (tmp_path / "merged" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    parts = sorted((tmp_path / "parts" / "parts").iterdir())
    assert len(parts) >= 2
    for part in parts:
        check_schema(json.loads(part.read_text()), "perceptree.predictions")


def test_a_dataset_at_a_url_makes_the_same_report(
    call: Call, checkpoint: Path, posts: Path, tmp_path: Path, small_blocks: None
) -> None:
    pytest.importorskip("fsspec")
    from basetree.jobs import copy_folder, open_store

    url = "memory://posts/data"
    copy_folder(posts, open_store(url))
    whole, _ = evaluated(call, "eval", checkpoint, posts, "--split", "train")
    options = ("--split", "train", "--shards", tmp_path / "parts", "--out", tmp_path / "report")
    merged, told = evaluated(call, "eval", checkpoint, url, *options)
    assert "evaluating: " in told
    assert merged["data"].pop("folder") == url
    whole["data"].pop("folder")
    assert merged == whole
    assert (tmp_path / "report" / "report.html").is_file()


def test_labels_that_changed_meanwhile_are_seen(
    call: Call, checkpoint: Path, posts: Path, tmp_path: Path
) -> None:
    import shutil

    data = tmp_path / "data"
    shutil.copytree(posts, data)
    options = ("--split", "train", "--shards", tmp_path / "parts", "--shard", "1/1")
    evaluated(call, "eval", checkpoint, data, *options)
    labels = data / "train_RGB.json"
    labels.write_text(labels.read_text() + " ")
    code, _, told = call("merge", tmp_path / "parts")
    assert code == 2
    assert "has other labels than the shards were made with" in told


def test_keypoints_of_a_second_file_that_changed_are_seen(posts: Path) -> None:
    (posts / "annotations").mkdir()
    content = json.loads((posts / "test_RGB.json").read_text())
    second = posts / "annotations/person_keypoints_Test.json"
    second.write_text(json.dumps(content))
    for annotation in content["annotations"]:
        del annotation["keypoints"]
    content["categories"] = [{"id": 1, "name": "tree"}]
    (posts / "annotations/instances_Test.json").write_text(json.dumps(content))
    for split in ("train", "val", "test"):
        (posts / f"{split}_RGB.json").unlink()
    before = read_dataset(posts, "test")
    assert before.labels.keypoints == second
    sha256 = shards.labels_sha256(before)
    second.write_text(second.read_text().replace("57.5", "56.5"))
    assert shards.labels_sha256(read_dataset(posts, "test")) != sha256


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--shard", "1/2"), "--shards is missing"),
        (("--ray", "local"), "--shards is missing"),
        (("--shards", "parts", "--shard", "1/2", "--out", "report"), "--out given with --shard"),
        (("--shards", "parts", "--ray", "local", "--device", "cuda"), "--device is cuda with"),
        (("--shards", "ftp://host/parts"), "unknown kind of store 'ftp'"),
    ],
)
def test_wrong_options_are_one_line(
    call: Call, checkpoint: Path, posts: Path, options: tuple[str, ...], message: str
) -> None:
    code, printed, told = call("eval", checkpoint, posts, "--split", "train", *options)
    assert (code, printed) == (2, "")
    assert message in told
    assert len(told.splitlines()) == 1
