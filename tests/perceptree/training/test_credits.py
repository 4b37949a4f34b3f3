"""A checkpoint names whose weights and photographs it has learned from."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from perceptree.models import TreeRCNN, load_checkpoint, save_checkpoint
from perceptree.models.packaged import PACKAGED_WEIGHTS, PackagedWeights
from perceptree.training import train
from perceptree.training.credits import joined_credits, training_credits
from perceptree.training.soup import average_checkpoints

Make = Callable[..., Any]
WEIGHTS = {"weights": "lite.pth", "sha256": "12", "licence": "Apache-2.0"}
BARK = {"kind": "bark", "source": "someone", "licence": "CC BY 4.0 Someone", "names": ["oak"]}
MOSS = {"kind": "ground", "source": "other", "licence": "CC0", "names": ["moss"]}


def test_credits_are_joined_each_once_without_empty_ones() -> None:
    assert joined_credits([{"steps": 3}, {}]) == {}
    found = joined_credits(
        [{"pretrained": [WEIGHTS], "photographs": [BARK]}, {"photographs": [MOSS, BARK]}]
    )
    assert found == {"pretrained": [WEIGHTS], "photographs": [BARK, MOSS]}


def test_a_training_passes_on_those_of_its_start_and_adds_its_datas(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    start = tmp_path / "start.safetensors"
    save_checkpoint(start, TreeRCNN(narrow()), {"pretrained": [WEIGHTS], "photographs": [BARK]})
    (posts / "settings.json").write_text(json.dumps({"textures": [MOSS]}), "utf-8")
    report = train(narrow(), plan(steps=1), posts, tmp_path / "run", init=start)
    record = load_checkpoint(report.checkpoint)[1]["training"]
    assert record["pretrained"] == [WEIGHTS]
    assert record["photographs"] == [BARK, MOSS]
    went_on = train(narrow(), plan(steps=1), posts, tmp_path / "branch", branch=tmp_path / "run")
    record = load_checkpoint(went_on.checkpoint)[1]["training"]
    assert (record["pretrained"], record["photographs"]) == ([WEIGHTS], [MOSS, BARK])
    _, averaged = average_checkpoints([report.checkpoint, report.checkpoint], [1, 1])
    assert averaged["photographs"] == [BARK, MOSS]


def test_weights_of_a_package_are_named_with_their_licence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "lite_weights" / "models" / "lite.pth"
    file.parent.mkdir(parents=True)
    torch.save({}, file)
    monkeypatch.syspath_prepend(str(tmp_path))
    known = PACKAGED_WEIGHTS | {"efficientnet_lite0": PackagedWeights("lite_weights", "lite.pth")}
    monkeypatch.setattr("perceptree.training.starting.PACKAGED_WEIGHTS", known)
    (weights,) = training_credits("imagenet", "efficientnet_lite0", [], [])["pretrained"]
    assert weights["weights"] == "lite.pth"
    assert weights["licence"] == "Apache-2.0"
    assert len(weights["sha256"]) == 64
