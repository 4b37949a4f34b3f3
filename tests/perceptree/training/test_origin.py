"""A checkpoint names its scenes, how its pictures look, and how far trees are labelled."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from calib import DepthEncoding, picture_statistics
from perceptree.data import read_frame, read_split
from perceptree.data.stated import labelled_reach_m
from perceptree.models import load_checkpoint
from perceptree.settings.training import DataSource
from perceptree.training import train

Make = Callable[..., Any]


def test_scenes_are_told_by_the_seed_of_their_dataset(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, edit_split: Make
) -> None:
    def simulated(content: dict[str, Any]) -> None:
        seeds = (101_000_000, 101_000_507, 7_000_002)
        for image, seed in zip(content["images"], seeds, strict=False):
            image["scene"] = {"seed": seed}

    edit_split(posts, "train", simulated)
    report = train(narrow(), plan(steps=1), posts, tmp_path / "run")
    assert load_checkpoint(report.checkpoint)[1]["training"]["scenes"] == [
        {"seed": 7, "scenes": 3, "frames": 1},
        {"seed": 101, "scenes": 508, "frames": 2},
    ]


@pytest.mark.parametrize("scene", ["north plot", None])
def test_a_scene_that_is_a_name_is_no_simulated_one(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, edit_split: Make, scene: str | None
) -> None:
    def named(content: dict[str, Any]) -> None:
        for image in content["images"]:
            image["scene"] = scene

    edit_split(posts, "train", named)
    report = train(narrow(), plan(steps=1), posts, tmp_path / "run")
    assert load_checkpoint(report.checkpoint)[1]["training"]["scenes"] == []


def stated(folder: Path, content: object) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "settings.json").write_text(json.dumps(content), "utf-8")
    return folder


def test_how_far_trees_are_labelled_is_recorded(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    stated(posts, {"settings": {"labels": {"reach_m": 12}}})
    report = train(narrow(), plan(steps=1), posts, tmp_path / "run")
    assert load_checkpoint(report.checkpoint)[1]["training"]["reach_m"] == 12.0


def test_a_label_file_that_is_mixed_in_brings_what_its_folder_states(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    owed = [{"kind": "bark", "source": "someone"}]
    stated(posts, {"settings": {"labels": {"reach_m": 12}}, "textures": owed})
    other = tmp_path / "other"
    shutil.copytree(posts, other)
    (posts / "settings.json").write_text('{"reach_m": 12}')
    source = DataSource(posts, mix=other / "train_RGB.json")
    report = train(narrow(), plan(steps=1, batch=2, mix_share=0.5), source, tmp_path / "run")
    training = load_checkpoint(report.checkpoint)[1]["training"]
    assert training["reach_m"] == 12.0
    assert training["photographs"] == owed


def test_datasets_of_one_reach_are_told_from_others(tmp_path: Path) -> None:
    near = stated(tmp_path / "near", {"settings": {"labels": {"reach_m": 10.0}}})
    joined = stated(tmp_path / "joined", {"textures": [], "reach_m": 10.0})
    far = stated(tmp_path / "far", {"settings": {"labels": {"reach_m": 20.0}}})
    odd = stated(tmp_path / "odd", [1])

    assert labelled_reach_m([near, joined]) == 10.0
    assert labelled_reach_m([near, far]) is None
    assert labelled_reach_m([near, odd]) is None
    assert labelled_reach_m([near, tmp_path / "none"]) is None


@pytest.mark.parametrize("value", [-1, 0, "10", True, None, [10], 10**400, float("inf")])
def test_a_reach_that_is_no_distance_is_none(tmp_path: Path, value: object) -> None:
    assert labelled_reach_m([stated(tmp_path, {"reach_m": value})]) is None


def test_pictures_are_told_without_the_padding_of_the_input(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    report = train(narrow(), plan(steps=1), posts, tmp_path / "run")
    training = load_checkpoint(report.checkpoint)[1]["training"]
    assert training["scenes"] == []
    looks = training["pictures"]
    frame = read_split(posts, "train")[0]
    assert (frame.width, frame.height) == (128, 72)
    assert looks["reading_percent"] == [100, 100]  # the padding of 128x72 in 128x64 has none
    assert looks["median_m"] == pytest.approx([12, 12], abs=0.1)
    assert set(looks) == set(picture_statistics(read_frame(frame, "depth"), DepthEncoding()))
