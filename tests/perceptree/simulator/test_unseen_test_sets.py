"""No scene of a frozen test set is among those that the shipped models were made with."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from perceptree.simulator.dataset.frozen import FROZEN_PRESETS
from perceptree.simulator.dataset.generate import scene_jobs
from perceptree.simulator.dataset.plan import DatasetPlan
from perceptree.simulator.settings.presets import PRESETS

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "edgetree/assets/models"
CARDS = sorted(FOLDER.glob("*.json"))
ALL_CARDS = [*CARDS, *sorted((ROOT / "models").glob("*.json"))]


def frozen_scenes(name: str) -> set[int]:
    """Seeds of the scenes of a frozen set; the same seed and mix give the same scene."""
    preset = PRESETS[name]
    jobs = scene_jobs(
        Path(), preset.frames, DatasetPlan(preset.settings, preset.seed, preset.files)
    )
    return {job.scene_seed for job in jobs}


def made_with(card: dict[str, Any]) -> set[int]:
    """Seeds of the scenes in a card, whatever the settings that they were drawn with."""
    return {seed for entry in card["training_scenes"] for seed in scenes_of(entry)}


def scenes_of(entry: dict[str, Any]) -> set[int]:
    """Seeds of the first scenes of a dataset, as the simulator derives them."""
    preset = PRESETS["test"]  # all of its scenes are in one split, so that few are no error
    settings = replace(preset.settings, views_per_scene=1)
    jobs = scene_jobs(Path(), entry["scenes"], DatasetPlan(settings, entry["seed"], preset.files))
    return {job.scene_seed for job in jobs}


def shared(card: dict[str, Any]) -> list[str]:
    """The frozen sets that a card shares scenes with."""
    return [name for name in FROZEN_PRESETS if frozen_scenes(name) & made_with(card)]


def read(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text("utf-8")))


@pytest.mark.parametrize("path", ALL_CARDS, ids=[path.stem for path in ALL_CARDS])
def test_no_model_was_made_with_a_scene_of_a_test_set(path: Path) -> None:
    card = read(path)
    assert len(made_with(card)) > 1000
    assert shared(card) == []


@pytest.mark.parametrize("path", ALL_CARDS, ids=[path.stem for path in ALL_CARDS])
def test_a_card_names_the_scenes_of_every_kind_of_use(path: Path) -> None:
    uses = {entry["use"] for entry in read(path)["training_scenes"]}
    assert {"training", "scale of the scores", "ranges of INT8"} <= uses


def test_every_shipped_model_has_a_card() -> None:
    models = sorted(FOLDER.glob("*.onnx"))
    assert [path.stem for path in models] == [path.stem for path in CARDS]
    expected = {
        f"{size}-{modality}" for size in ("edge-n", "edge-s") for modality in ("depth", "rgb")
    }
    assert expected <= {path.stem for path in models}


def test_the_seeds_in_the_readme_are_in_the_cards() -> None:
    readme = (FOLDER / "README.md").read_text("utf-8")
    told = {int(seed) for seed in re.findall(r"seed (\d+)", readme)}
    assert told == {entry["seed"] for path in CARDS for entry in read(path)["training_scenes"]}
    assert {101, 301, 909} <= told


@pytest.mark.parametrize("name", FROZEN_PRESETS)
def test_a_card_with_a_frozen_seed_is_found_out(name: str) -> None:
    entry = {
        "use": "training",
        "data": "paper",
        "seed": PRESETS[name].seed,
        "scenes": 1,
        "frames": 4,
    }
    assert shared({"training_scenes": [entry]}) == [name]


def test_scenes_of_different_seeds_never_meet() -> None:
    one, next_one = ({"seed": seed, "scenes": 50_000} for seed in (43, 44))
    assert max(scenes_of(one)) < min(scenes_of(next_one))
