"""Validation of the augmentation settings."""

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from basetree.errors import SettingsError
from perceptree.data import AugmentSettings
from perceptree.data.augment import PAPER_AUGMENT

NUMBERS = [
    entry.name
    for entry in dataclasses.fields(AugmentSettings)
    if isinstance(entry.default, int | float)
]


@pytest.mark.parametrize("name", NUMBERS)
def test_negative_and_nan_strengths_are_rejected(name: str) -> None:
    for value in (-1, np.nan, np.inf):
        with pytest.raises(SettingsError, match=rf"{name} is {value}: expected"):
            AugmentSettings(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("flip_share", 1.5),
        ("scale", (1.2, 0.8)),
        ("scale", (0.0, 1.0)),
        ("scale", (1.0, np.inf)),
        ("crop", (0.5, 1.1)),
        ("crop", (0.0, 1.0)),
        ("rotation_deg", 45),
        ("shear_deg", 45),
        ("perspective", 0.5),
        ("holes", 2.5),
        ("jpeg_quality", (30, 101)),
        ("copy_paste_share", 2),
        ("camera_zoom", (4, 1)),
        ("camera_width_px", (0, 640)),
        ("portrait_share", 2),
    ],
)
def test_strengths_out_of_range_are_rejected(name: str, value: Any) -> None:
    with pytest.raises(SettingsError, match=rf"{name} is .*: expected"):
        AugmentSettings(**{name: value})


@pytest.mark.parametrize("kinds", [{"radar": 1.0}, {"stereo": 0.0}, {"tof": -1.0}])
def test_kinds_of_cameras_are_checked(kinds: dict[str, float]) -> None:
    with pytest.raises(SettingsError, match=r"camera_kinds.*: expected"):
        AugmentSettings(camera_kinds=kinds)


def test_the_papers_crop_is_square() -> None:
    assert PAPER_AUGMENT.crop_share == 1
    assert (np.array(PAPER_AUGMENT.crop) * (1280, 720)).tolist() == [720, 720]
    assert PAPER_AUGMENT.flip_share == 0.5
    assert (PAPER_AUGMENT.depth_noise, PAPER_AUGMENT.holes) == (0, 0)


def test_settings_are_json_ready() -> None:
    values = json.loads(json.dumps(dataclasses.asdict(PAPER_AUGMENT)))
    tuples = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
    assert AugmentSettings(**tuples) == PAPER_AUGMENT
