"""The JSON Schema of settings says what their fields say."""

import json
from pathlib import Path
from typing import Any

import pytest

from basetree.settings import json_schema

jsonschema = pytest.importorskip("jsonschema")
pytest.importorskip("numba")


@pytest.fixture(scope="module")
def validator() -> Any:
    from perceptree.simulator.settings import SimulatorSettings

    schema = json.loads(json.dumps(json_schema(SimulatorSettings)))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_all_presets_of_the_simulator_are_valid(validator: Any) -> None:
    from perceptree.simulator.settings.presets import PRESETS

    for preset in PRESETS.values():
        validator.validate(json.loads(json.dumps(preset.settings.to_dict())))


CHANGES: list[tuple[Any, bool]] = [
    ({}, True),
    ({"stand": {"stems_per_ha": [400, 500]}}, True),
    ({"stand": {"stems_per_ha": [400]}}, False),
    ({"stand": {"stems_per_ha": [1, 500]}}, False),
    ({"stand": {"stems": 3}}, False),
    ({"stand": {"fine_crowns": 1}}, False),
    ({"views_per_scene": 2.5}, False),
    ({"views_per_scene": 1000}, True),
    ({"labels": {"reach_m": 15}}, False),
    ({"labels": {"cut_rule": "low"}}, False),
    ({"weather": {"kinds": {"fog": 1}}}, True),
    ({"weather": {"kinds": {"fog": -1}}}, False),
    ({"weather": {"kinds": {"hail": 1}}}, False),
    ([1], False),
]


@pytest.mark.parametrize(("changes", "is_valid"), CHANGES)
def test_the_schema_takes_what_the_settings_file_may_hold(
    validator: Any, tmp_path: Path, changes: Any, is_valid: bool
) -> None:
    from basetree.errors import SettingsError
    from perceptree.simulator.settings import SimulatorSettings
    from perceptree.simulator.settings.reading import read_settings

    assert validator.is_valid(changes) == is_valid
    path = tmp_path / "forest.json"
    path.write_text(json.dumps(changes))
    try:
        read_settings(path, SimulatorSettings())
    except SettingsError:
        assert not is_valid
    else:
        assert is_valid


def test_every_setting_of_the_simulator_has_words_and_most_have_defaults(validator: Any) -> None:
    properties = validator.schema["properties"]
    bare = [
        f"{group}.{name}"
        for group, content in properties.items()
        for name, setting in content.get("properties", {}).items()
        if group != "camera" and ("description" not in setting or "default" not in setting)
    ]
    assert bare == []
    reach = properties["labels"]["properties"]["reach_m"]
    assert reach.pop("description").startswith("Maximum distance of a labelled tree from the")
    assert reach == {"type": "number", "minimum": 1, "maximum": 13, "default": 10.0}
