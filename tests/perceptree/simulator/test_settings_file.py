"""Settings files: changed values, and errors for invalid ones."""

import dataclasses
import json
from pathlib import Path

import pytest

from basetree.errors import SettingsError
from perceptree.simulator import PRESETS, SimulatorSettings, StandSettings, ideal_camera
from perceptree.simulator.settings.reading import read_settings


def written(folder: Path, values: object) -> Path:
    path = folder / "forest.json"
    path.write_text(values if isinstance(values, str) else json.dumps(values))
    return path


def test_only_what_the_file_names_changes(tmp_path: Path):
    values = {
        "stand": {"stems_per_ha": [400, 500], "patterns": {"clustered": 1}},
        "labels": {"reach_m": 12},
        "views_per_scene": 3,
    }
    start = PRESETS["paper"].settings
    changed = read_settings(written(tmp_path, values), start)
    assert changed == dataclasses.replace(
        start,
        stand=StandSettings(stems_per_ha=(400, 500), patterns={"clustered": 1}),
        labels=dataclasses.replace(start.labels, reach_m=12.0),
        views_per_scene=3,
    )


@pytest.mark.parametrize(("model", "std_px"), [("radtan", 0.0), ("fisheye", 0.4)])
def test_a_whole_tree_comes_back_as_it_was_written(tmp_path: Path, model: str, std_px: float):
    bent = {"distortion": (-0.2, 0.05, 0.0, 0.0), "distortion_model": model, "focal_std_px": std_px}
    bent["principal_std_px"] = std_px or None
    camera = dataclasses.replace(ideal_camera(640, 360), **bent)
    base = PRESETS["plain"].settings
    saved = dataclasses.replace(base, camera=dataclasses.replace(base.camera, intrinsics=camera))
    record = {"settings": saved.to_dict(), "seed": 1, "sha256": "x"}
    for start in (SimulatorSettings(), PRESETS["field"].settings):
        assert read_settings(written(tmp_path, record), start) == saved


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ("{", r"forest.json: not JSON"),
        ([1], r"forest.json: the file is \[1\]: expected an object of settings"),
        ({"trees": 1}, r"forest.json: trees is no setting: expected some of terrain, stand,"),
        ({"stand": {"stems": 1}}, r"stand.stems is no setting: expected some of stems_per_ha,"),
        ({"stand": 3}, r"stand. is 3: expected an object"),
        ({"stand": {"stems_per_ha": 400}}, r"stand.stems_per_ha is 400: expected a list"),
        ({"stand": {"stems_per_ha": [400]}}, r"stems_per_ha is \[400\]: expected 2 numbers"),
        ({"stand": {"stems_per_ha": [900, 1]}}, r"stems_per_ha is \(900, 1\): expected low <="),
        ({"weather": {"kinds": ["fog"]}}, r"weather.kinds is \['fog'\]: expected an object of w"),
        (
            {"weather": {"kinds": {"hail": 1}}},
            r"weather kinds has the name 'hail': expected one of",
        ),
        (
            {"camera": {"intrinsics": {"principal_std_px": "one"}}},
            r"camera.intrinsics.principal_std_px is 'one': expected a number, or null for none",
        ),
        ({"labels": {"reach_m": "ten"}}, r"labels.reach_m is 'ten': expected a number"),
        ({"labels": {"reach_m": 10**400}}, r"labels.reach_m is 1000.*: expected a number"),
        ({"labels": {"reach_m": float("inf")}}, r"labels.reach_m is inf: expected a number"),
        ({"stand": {"stems_per_ha": [1, 10**400]}}, r"stems_per_ha is .*: expected a list of num"),
        ({"depth": {"half_resolution": 1}}, r"half_resolution is 1: expected true or false"),
        ({"views_per_scene": 2.5}, r"views_per_scene is 2.5: expected a whole number"),
    ],
)
def test_what_is_no_setting_is_named_with_what_was_expected(tmp_path: Path, values, message: str):
    with pytest.raises(SettingsError, match=message):
        read_settings(written(tmp_path, values), SimulatorSettings())


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(SettingsError, match=r"none.json: cannot be read"):
        read_settings(tmp_path / "none.json", SimulatorSettings())
