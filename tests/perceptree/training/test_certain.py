"""Training with ignored trees: exact resuming, the same with workers, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from basetree.errors import SettingsError
from perceptree.errors import CheckpointError, DatasetError
from perceptree.models import load_checkpoint
from perceptree.training import DataSource, Engine, Preparing, train
from perceptree.training.source import open_data

Make = Callable[..., Any]
Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def source(posts: Path, edit_split: Callable[..., None]) -> DataSource:
    """Posts at 5 m; every third is at 9.5 m, where labels are not certain."""

    def move(content: dict[str, Any]) -> None:
        for annotation in content["annotations"]:
            annotation["distance_m"] = 9.5 if annotation["id"] % 3 == 0 else 5.0

    for split in ("train", "val"):
        edit_split(posts, split, move)
    return DataSource(posts, certain_m=8.5)


def differing(first: dict[str, torch.Tensor], second: dict[str, torch.Tensor]) -> list[str]:
    return [name for name in first if not torch.equal(first[name], second[name])]


def test_resumed_and_with_workers_the_weights_are_the_same(
    source: DataSource, tmp_path: Path, narrow: Make, plan: Make, weights: Make, interrupt_at: Make
) -> None:
    whole = train(narrow(), plan(), source, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train(narrow(), plan(), source, tmp_path / "parts", interrupt_at(2))
    parts = train(narrow(), plan(), source, tmp_path / "parts")
    helped = train(narrow(), plan(), source, tmp_path / "helped", engine=Engine(workers=2))
    first = weights(whole.checkpoint)
    assert differing(first, weights(parts.checkpoint)) == []
    assert differing(first, weights(helped.checkpoint)) == []
    assert whole.metrics == parts.metrics == helped.metrics
    assert whole.metrics.trees == 3  # of 4 in three frames
    ungraded = train(narrow(), plan(), source.directory, tmp_path / "ungraded")
    assert differing(first, weights(ungraded.checkpoint))
    assert ungraded.metrics.trees == 4


def test_the_checkpoint_and_the_state_hold_the_distance(
    source: DataSource, tmp_path: Path, narrow: Make, plan: Make, interrupt_at: Make
) -> None:
    report = train(narrow(), plan(steps=1), source, tmp_path / "run")
    assert load_checkpoint(report.checkpoint)[1]["training"]["certain_m"] == 8.5
    with pytest.raises(KeyboardInterrupt):
        train(narrow(), plan(), source, tmp_path / "other", interrupt_at(1))
    farther = replace(source, certain_m=9.0)  # ignores the same trees
    with pytest.raises(CheckpointError, match=r"other data: certain_m was 8.5, is 9.0;"):
        train(narrow(), plan(), farther, tmp_path / "other")
    plain = train(narrow(), plan(steps=1), source.directory, tmp_path / "plain")
    assert "certain_m" not in load_checkpoint(plain.checkpoint)[1]["training"]


def test_both_rules_keep_caches_of_their_own_beside_each_other(
    source: DataSource, narrow: Make
) -> None:
    for one in (source, DataSource(source.directory)):
        open_data(one, narrow(), Engine(), Preparing())
    folders = sorted(path.name for path in (source.directory / ".frame-cache").iterdir())
    assert folders == ["train_RGB-depth-128x64", "train_RGB-depth-128x64-certain-8.5"]


def test_the_mix_is_graded_alike_and_all_is_said(
    source: DataSource, narrow: Make, tmp_path: Path
) -> None:
    told: list[str] = []
    engine = Engine(cache=str(tmp_path / "cache"))
    both = replace(source, mix=source.directory)
    data = open_data(both, narrow(), engine, Preparing(say=told.append))
    assert data.mixed is not None
    assert data.frames.trees == data.mixed.trees == 6
    assert [len(data.mixed[number].ignored) for number in range(6)] == [0, 1, 0, 1, 0, 1]
    said = [line.partition(": ")[2] for line in told if "ignored" in line]
    train_note = "3 of 9 annotations are ignored: 3 beyond 8.5 m"
    assert said == ["1 of 4 annotations are ignored: 1 beyond 8.5 m", train_note, train_note]


@pytest.mark.parametrize("split", ["train", "val"])
def test_a_split_whose_trees_are_all_ignored_is_refused(
    posts: Path, edit_split: Callable[..., None], narrow: Make, plan: Make, split: str
) -> None:
    def ignore(content: dict[str, Any]) -> None:
        for number, annotation in enumerate(content["annotations"]):
            annotation.update({"ignore": 1} if number else {"iscrowd": 1, "segmentation": None})

    edit_split(posts, split, ignore)
    message = rf"posts: the {split} split has no tree that counts \(. of . annotations are ignored"
    with pytest.raises(DatasetError, match=message) as caught:
        train(narrow(), plan(), posts, posts / "run")
    assert "1 by iscrowd, " in str(caught.value)
    assert str(caught.value).endswith(" by ignore), expected at least one")


def test_the_command_trains_with_a_certain_distance(
    source: DataSource, call: Call, tmp_path: Path
) -> None:
    options = ("--height", 64, "--width", 96, "--steps", 1, "--batch", 2)
    code, _, told = call(
        "train", source.directory, "--out", tmp_path / "run", "--certain", 8.5, *options
    )
    assert code == 0, told
    assert "train_RGB.json: 3 of 9 annotations are ignored: 3 beyond 8.5 m" in told
    record = load_checkpoint(tmp_path / "run/best.safetensors")[1]["training"]
    assert record["certain_m"] == 8.5


def test_the_command_refuses_other_distances(posts: Path, call: Call, tmp_path: Path) -> None:
    code, _, told = call("train", posts, "--out", tmp_path / "run", "--certain", 0)
    assert (code, told.count("\n")) == (2, 1)
    assert "certain distance is 0.0 m: expected more than 0" in told
    code, _, told = call("train", posts, "--out", tmp_path / "run", "--certain", 4)
    assert (code, told.count("\n")) == (2, 1)
    assert (
        "the val split has no tree that counts (4 of 4 annotations are ignored: 4 beyond 4 m)"
        in told
    )
    more = ("--simulate", 20, "--minutes", 1)
    code, _, told = call("train", posts, "--out", tmp_path / "run", "--certain", 4, *more)
    assert (code, told) == (
        2,
        "perceptree: --simulate excludes --certain: expected one of the two\n",
    )
    with pytest.raises(SettingsError, match="certain distance is -1 m"):
        DataSource(posts, certain_m=-1)
