"""A second dataset is mixed into each batch, so that a fine-tuned model does not forget."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from basetree.errors import SettingsError
from perceptree.data import read_split
from perceptree.data.cache import FrameCache, open_cache
from perceptree.errors import CheckpointError, DatasetError
from perceptree.models import load_checkpoint
from perceptree.training import DataSource, Engine, train
from perceptree.training.batches import TrainingFrames

Make = Callable[..., Any]
Write = Callable[..., Path]


@pytest.fixture
def general(write_dataset: Write, tmp_path: Path) -> Path:
    """A dataset of five frames beside the one of `posts`, with the same file names."""
    folder = tmp_path / "general"
    shutil.move(write_dataset(train=5, val=1, test=1), folder)
    return folder


@pytest.fixture
def source(general: Path, write_dataset: Write) -> DataSource:
    return DataSource(write_dataset(), mix=general)


def caches(source: DataSource, tmp_path: Path, narrow: Make) -> list[FrameCache]:
    return [
        open_cache(read_split(folder, "train"), narrow(), tmp_path / f"cache-{folder.name}")
        for folder in (source.directory, source.mix)
        if folder is not None
    ]


def test_each_batch_has_its_share_and_each_epoch_shows_every_frame(
    source: DataSource, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    own, mixed = caches(source, tmp_path, narrow)
    frames = TrainingFrames(own, narrow(), plan(batch=8, mix_share=0.25), mixed)
    shown: dict[int, list[int]] = {id(own): [], id(mixed): []}
    for step in range(5):
        places = [frames.frame_at(step, row) for row in range(8)]
        assert [cache is mixed for cache, _ in places] == 2 * [False, False, False, True]
        for cache, index in places:
            shown[id(cache)].append(index)
    for cache, epochs in ((own, 5), (mixed, 2)):
        size = len(cache)
        order = shown[id(cache)]
        parts = [order[number * size : (number + 1) * size] for number in range(epochs)]
        assert [sorted(part) for part in parts] == [list(range(size))] * epochs
        assert len({tuple(part) for part in parts}) == epochs


def test_without_a_mix_the_order_is_that_of_older_runs(
    source: DataSource, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    own, _ = caches(source, tmp_path, narrow)
    frames = TrainingFrames(own, narrow(), plan(batch=2, seed=7))
    order = [frames.frame_at(*divmod(position, 2))[1] for position in range(12)]
    known = [np.random.default_rng([7, 1, epoch]).permutation(6) for epoch in (0, 1)]
    assert order == np.concatenate(known).tolist()


def test_a_resumed_mix_equals_an_uninterrupted_one(
    source: DataSource, tmp_path: Path, narrow: Make, plan: Make, weights: Make, interrupt_at: Make
) -> None:
    settings = plan(steps=4, batch=4, mix_share=0.5)
    whole = train(narrow(), settings, source, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train(narrow(), settings, source, tmp_path / "parts", interrupt_at(2))
    parts = train(narrow(), settings, source, tmp_path / "parts")
    first, second = weights(whole.checkpoint), weights(parts.checkpoint)
    assert [name for name in first if not torch.equal(first[name], second[name])] == []
    itself = DataSource(source.directory, mix=source.directory)
    other = weights(train(narrow(), settings, itself, tmp_path / "itself").checkpoint)
    assert [name for name in first if not torch.equal(first[name], other[name])]


def test_a_run_goes_on_with_the_same_mix_only(
    source: DataSource, tmp_path: Path, narrow: Make, plan: Make, interrupt_at: Make
) -> None:
    settings = plan(batch=4, mix_share=0.5)
    with pytest.raises(KeyboardInterrupt):
        train(narrow(), settings, source, tmp_path / "run", interrupt_at(1))
    assert source.mix is not None
    image = source.mix / "depth8/000000.png"
    cv2.imwrite(str(image), np.full((72, 128), 99, np.uint8))
    with pytest.raises(CheckpointError, match="mixed frames hash was"):
        train(narrow(), settings, source, tmp_path / "run")


def test_the_checkpoint_names_both_and_tells_how_all_pictures_look(
    source: DataSource, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    assert source.mix is not None
    for path in (source.mix / "depth8").iterdir():  # a forest much farther away
        cv2.imwrite(str(path), np.full((72, 128), 230, np.uint8))
    engine = Engine(cache=str(tmp_path / "caches"))
    settings = plan(steps=1, batch=4, mix_share=0.5)
    report = train(narrow(), settings, source, tmp_path / "run", engine=engine)
    record = load_checkpoint(report.checkpoint)[1]["training"]
    assert (record["data"], record["frames"]) == ("posts, general", 11)
    assert record["settings"]["mix_share"] == 0.5
    low, high = record["pictures"]["median_m"]
    assert (low, high) == pytest.approx((12.0, 18.0), abs=0.1)
    assert len(list((tmp_path / "caches").iterdir())) == 2


def test_both_or_none_of_share_and_dataset_are_needed(
    source: DataSource, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    with pytest.raises(SettingsError, match=r"mix_share is 0 and the dataset .*general"):
        train(narrow(), plan(), source, tmp_path / "run")
    with pytest.raises(SettingsError, match=r"mix_share is 0.5 and the dataset .* None"):
        train(narrow(), plan(mix_share=0.5), source.directory, tmp_path / "run")


@pytest.mark.parametrize("share", [0.1, 1.0, -0.5, float("nan")])
def test_a_share_leaves_a_frame_of_each_in_a_batch(plan: Make, share: float) -> None:
    with pytest.raises(SettingsError, match=f"mix_share is {share:g} of a batch of 2: expected"):
        plan(mix_share=share)


def test_a_mix_without_trees_is_refused(
    source: DataSource, tmp_path: Path, narrow: Make, plan: Make, edit_split: Make
) -> None:
    edit_split(source.mix, "train", lambda content: content.update(annotations=[]))
    with pytest.raises(DatasetError, match="general: the train split has no labelled tree"):
        train(narrow(), plan(mix_share=0.5), source, tmp_path / "run")
