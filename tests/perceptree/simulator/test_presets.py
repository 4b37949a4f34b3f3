"""Presets: their settings, and the unchanged frozen test sets."""

import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from perceptree.simulator.dataset import frozen
from perceptree.simulator.dataset.frozen import (
    FROZEN_PRESETS,
    FrozenSet,
    compare_with_frozen,
    content_sha256,
    describe_dataset,
    preset_sha256,
    read_frozen,
)
from perceptree.simulator.dataset.generate import generate_dataset
from perceptree.simulator.dataset.plan import settings_sha256
from perceptree.simulator.dataset.splits import assign_splits
from perceptree.simulator.settings import GROUNDS, TIMES, WEATHERS
from perceptree.simulator.settings.files import FileSettings
from perceptree.simulator.settings.presets import PRESETS


@pytest.fixture
def dataset(tmp_path: Path, synth: ModuleType, in_process: None) -> Path:
    """Twelve frames of noise, all in the test split."""
    settings = replace(synth.small_settings(), splits=PRESETS["test"].settings.splits)
    generate_dataset(tmp_path, 12, settings, 3)
    return tmp_path


def test_presets_are_found_by_their_own_name():
    names = ["paper", "test", "field", "vegetation", "drive", "field-test", "plain"]
    assert list(PRESETS) == names
    assert all(preset.name == name for name, preset in PRESETS.items())


@pytest.mark.parametrize("name", ["paper", "test"])
def test_the_papers_mix_holds_every_ground_weather_and_light(name: str):
    settings = PRESETS[name].settings
    for shares, known in (
        (settings.terrain.grounds, GROUNDS),
        (settings.weather.kinds, WEATHERS),
        (settings.light.times, ("morning", "daylight", "evening", "dusk")),
    ):
        assert all(shares[key] > 0 for key in known)
    camera = settings.camera.intrinsics
    assert (camera.width, camera.height) == (1280, 720)


def test_the_paper_preset_has_40k_1k_and_2k_frames():
    preset = PRESETS["paper"]
    views = preset.settings.views_per_scene
    assigned = assign_splits(preset.frames // views, preset.settings.splits)
    frames = [views * assigned.count(split) for split in ("train", "val", "test")]
    assert frames == [40_000, 1_000, 2_000]


def test_the_test_preset_is_of_the_papers_mix_and_all_test():
    paper, test = PRESETS["paper"], PRESETS["test"]
    same = {"splits": paper.settings.splits, "depth": paper.settings.depth}
    assert replace(test.settings, **same) == paper.settings
    exact = {"exact_range_m": 15.0, "exact_stride_px": 2}
    assert replace(test.settings.depth, **exact) == paper.settings.depth
    assert test.settings.depth.exact_stride_px == 1
    assert (test.seed, test.frames) == (44, 400)
    assert set(assign_splits(75, test.settings.splits)) == {"test"}
    assert test.seed != paper.seed


def test_the_field_preset_holds_every_condition_and_all_that_is_beyond_the_papers():
    settings = PRESETS["field"].settings
    assert all(settings.terrain.grounds[name] > 0 for name in GROUNDS)
    assert all(settings.weather.kinds[name] > 0 for name in WEATHERS)
    assert all(settings.light.times[name] > 0 for name in TIMES)
    for part in (settings.clutter, settings.objects, settings.negatives):
        assert all(high > 0 for _, high in vars(part).values())
    assert settings.imaging.share > 0
    assert 0.2 <= settings.trap.infrared_share <= 0.25
    assert settings.trap.caption_share == 0.25
    assert all(share > 0 for share in vars(settings.randomisation).values())
    assert settings.labels.cut_rule == "visible"


@pytest.mark.parametrize(
    ("name", "sha256"),
    [
        ("paper", "6c2bfda064a14d338de951bca70a77b905aa4fd9a3decf3c8529927f5873f987"),
        ("plain", "5dd1d2c5362a89ef1ce9796d18a200535a85ebbeedc3b1d10e5afc648a3c7fde"),
        ("vegetation", "45c7b195e259205fec7213871c35312814bbbaaa8ee9e5d1a2ff539aeebea7c7"),
        ("drive", "a8a7258b2f3b1142b2e7e915b57c4a8f6c214f65d2c5e183a397a1d0196b454a"),
    ],
)
def test_older_presets_are_known_by_the_hash_that_they_always_had(name: str, sha256: str):
    preset = PRESETS[name]
    assert settings_sha256(preset.settings, preset.seed, preset.files) == sha256


def test_the_plain_preset_is_clear_daylight_on_one_ground():
    settings = PRESETS["plain"].settings
    assert settings.weather.kinds == {"clear": 1.0}
    assert settings.light.times == {"daylight": 1.0}
    assert len(settings.terrain.grounds) == 1
    assert set(settings.stand.species) == {"fir", "beech"}


@pytest.mark.parametrize("name", FROZEN_PRESETS)
def test_a_test_presets_settings_are_the_frozen_ones(name: str):
    kept = read_frozen(name)
    preset = PRESETS[name]
    assert (kept.name, kept.seed, kept.frames) == (preset.name, preset.seed, preset.frames)
    assert kept.settings_sha256 == preset_sha256(name), (
        f"the preset {name} changed: figures measured on it before no longer compare; if that is"
        " meant, run release/freeze_test_set.py"
    )


def test_the_test_sets_hold_other_scenes_than_the_mixes_they_are_of():
    assert len({PRESETS[name].seed for name in ("paper", "test", "field", "field-test")}) == 4


def test_any_setting_changes_the_settings_hash():
    preset = PRESETS["test"]
    before = settings_sha256(preset.settings, preset.seed)
    rgb = replace(preset.settings.rgb, jpeg_quality=preset.settings.rgb.jpeg_quality - 1)
    assert settings_sha256(replace(preset.settings, rgb=rgb), preset.seed) != before
    assert settings_sha256(preset.settings, preset.seed + 1) != before
    assert settings_sha256(preset.settings, preset.seed, FileSettings("png")) != before


def test_a_dataset_equals_itself(dataset: Path):
    comparison = compare_with_frozen(dataset, describe_dataset(dataset, "test"))
    assert (comparison.files, comparison.differing, comparison.complaints) == (49, 0, [])


def test_what_is_frozen_is_told_by_the_labels(dataset: Path):
    kept = describe_dataset(dataset, "test")
    content = json.loads((dataset / "test_RGB.json").read_text())
    trees = content["annotations"]
    assert kept.trees_per_frame == pytest.approx(len(trees) / 12)
    third = sum(0.3 <= tree["visible_fraction"] < 0.4 for tree in trees) / len(trees)
    assert kept.occlusion[3] == pytest.approx(third, abs=1e-4)
    assert sum(kept.occlusion) == pytest.approx(1, abs=1e-3)
    assert FrozenSet(**json.loads(kept.to_json())) == kept


def test_a_flipped_byte_counts_and_is_no_complaint(dataset: Path):
    kept = describe_dataset(dataset, "test")
    image = dataset / "images/000003.jpg"
    image.write_bytes(image.read_bytes()[:-1] + b"x")
    (dataset / "depth/000005.png").unlink()
    comparison = compare_with_frozen(dataset, kept)
    assert (comparison.files, comparison.complaints) == (49, [])
    assert 2 <= comparison.differing <= 8  # a missing file shifts those of its folder


def test_labels_that_differ_are_told(dataset: Path):
    kept = describe_dataset(dataset, "test")
    path = dataset / "test_RGB.json"
    content = json.loads(path.read_text())
    del content["annotations"][:2]
    path.write_text(json.dumps(content))
    comparison = compare_with_frozen(dataset, kept)
    assert comparison.differing == 1
    assert comparison.complaints[0] == "1.333 trees a frame, expected 1.500"
    assert any("% of the trees are visible to" in line for line in comparison.complaints)


def test_the_content_hash_leaves_out_what_is_made_of_the_content(dataset: Path):
    before = content_sha256(dataset)
    (dataset / "statistics.html").unlink()
    assert content_sha256(dataset) == before
    (dataset / "images/000000.jpg").rename(dataset / "images/000099.jpg")
    assert content_sha256(dataset) != before


@pytest.mark.slow
@pytest.mark.parametrize("name", FROZEN_PRESETS)
def test_a_frozen_test_set_comes_out_again(tmp_path: Path, name: str):
    kept, preset = read_frozen(name), PRESETS[name]
    generate_dataset(tmp_path, preset.frames, preset.settings, preset.seed, files=preset.files)
    comparison = compare_with_frozen(tmp_path, kept)
    assert comparison.complaints == []
    if kept.versions == frozen.library_versions():
        assert comparison.differing == 0
