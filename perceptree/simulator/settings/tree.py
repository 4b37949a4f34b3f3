"""Everything a simulated dataset varies, as one frozen tree saved beside the frames."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from calib import PinholeCamera
from perceptree.errors import SettingsError
from perceptree.simulator.settings.atmosphere import LightSettings, WeatherSettings
from perceptree.simulator.settings.checks import LATER, check_choice, check_number
from perceptree.simulator.settings.drive import DriveSettings
from perceptree.simulator.settings.forest import (
    StandSettings,
    TerrainSettings,
    UndergrowthSettings,
)
from perceptree.simulator.settings.realism import (
    ClutterSettings,
    ImagingSettings,
    ObjectSettings,
    RandomisationSettings,
)
from perceptree.simulator.settings.sensors import CameraSettings, DepthSettings, RgbSettings

CUT_RULES = ("fixed", "visible")


@dataclass(frozen=True)
class LabelSettings:
    """Which trees are labelled and where their five keypoints lie.

    Heights are metres above the ground on the uphill side of the stem, ``stem_height_m`` above
    the ground at its axis. The axis keypoints lie at half and at a quarter of the labelled stem.
    """

    reach_m: float = 10.0
    stem_height_m: float = 4.0
    cut_height_m: float = 0.20
    diameter_height_m: float = 0.30
    min_visible_fraction: float = 0.08
    min_visible_area: float = 4e-4
    cut_rule: str = field(default="fixed", metadata=LATER)

    def __post_init__(self) -> None:
        check_choice("cut_rule", self.cut_rule, CUT_RULES)
        if not 0 < self.cut_height_m < self.diameter_height_m < self.stem_height_m / 4:
            raise SettingsError(
                "label heights must rise: 0 < cut_height_m < diameter_height_m < stem_height_m / 4,"
                f" got {self.cut_height_m}, {self.diameter_height_m}, {self.stem_height_m}"
            )
        check_number("reach_m", self.reach_m, 1.0, 40.0)
        check_number("stem_height_m", self.stem_height_m, 1.0, 12.0)
        check_number("min_visible_fraction", self.min_visible_fraction, 0.0, 1.0)
        check_number("min_visible_area", self.min_visible_area, 0.0, 1.0)


@dataclass(frozen=True)
class SplitSettings:
    """Shares of the scenes held out for validation and test; the rest is for training."""

    val: float = 0.1
    test: float = 0.1

    def __post_init__(self) -> None:
        check_number("val", self.val, 0.0, 0.5)
        check_number("test", self.test, 0.0, 1.0)
        if self.val + self.test > 1:
            raise SettingsError(
                f"val and test are {self.val:g} and {self.test:g}: expected a sum of at most 1"
            )


@dataclass(frozen=True)
class SimulatorSettings:
    """Everything that, with a seed, decides every pixel of a dataset."""

    terrain: TerrainSettings = field(default_factory=TerrainSettings)
    stand: StandSettings = field(default_factory=StandSettings)
    undergrowth: UndergrowthSettings = field(default_factory=UndergrowthSettings)
    weather: WeatherSettings = field(default_factory=WeatherSettings)
    light: LightSettings = field(default_factory=LightSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    rgb: RgbSettings = field(default_factory=RgbSettings)
    depth: DepthSettings = field(default_factory=DepthSettings)
    labels: LabelSettings = field(default_factory=LabelSettings)
    splits: SplitSettings = field(default_factory=SplitSettings)
    views_per_scene: int = 8
    clutter: ClutterSettings = field(default_factory=ClutterSettings, metadata=LATER)
    objects: ObjectSettings = field(default_factory=ObjectSettings, metadata=LATER)
    imaging: ImagingSettings = field(default_factory=ImagingSettings, metadata=LATER)
    randomisation: RandomisationSettings = field(
        default_factory=RandomisationSettings, metadata=LATER
    )
    drive: DriveSettings = field(default_factory=DriveSettings, metadata=LATER)

    def __post_init__(self) -> None:
        check_number("views_per_scene", self.views_per_scene, 1, 1000)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready copy.

        Settings that came later are left out while they have their defaults, so that data sets
        made before them are still known by the hash of their settings.
        """
        values = _record(self)
        values["camera"]["intrinsics"] = self.camera.intrinsics.to_dict()
        return values


def _record(node: Any) -> dict[str, Any]:
    """A dataclass as nested dictionaries."""
    values = {}
    for entry in dataclasses.fields(node):
        value = getattr(node, entry.name)
        if entry.metadata.get("later") and value == _default(entry):
            continue
        known = dataclasses.is_dataclass(value) and not isinstance(value, PinholeCamera)
        values[entry.name] = _record(value) if known else value
    return values


def _default(entry: dataclasses.Field[Any]) -> Any:
    factory = entry.default_factory
    return entry.default if factory is dataclasses.MISSING else factory()
