"""All settings of a simulated dataset in one nested dataclass, which is stored with the frames."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from basetree.errors import SettingsError
from calib import PinholeCamera
from perceptree.simulator.settings.atmosphere import LightSettings, WeatherSettings
from perceptree.simulator.settings.checks import OMIT_DEFAULT, check_choice, check_number
from perceptree.simulator.settings.drive import DriveSettings
from perceptree.simulator.settings.forest import (
    StandSettings,
    TerrainSettings,
    UndergrowthSettings,
)
from perceptree.simulator.settings.photographs import PhotographSettings
from perceptree.simulator.settings.realism import (
    ClutterSettings,
    ImagingSettings,
    NegativeSettings,
    ObjectSettings,
    RandomisationSettings,
)
from perceptree.simulator.settings.sensors import CameraSettings, DepthSettings, RgbSettings
from perceptree.simulator.settings.trap import TrapSettings
from perceptree.simulator.settings.vegetation import VegetationSettings

CUT_RULES = ("fixed", "visible")


@dataclass(frozen=True)
class LabelSettings:
    """Which trees are labelled, and where their five keypoints are.

    Attributes:
        reach_m: Maximum distance of a labelled tree from the camera, m.
        stem_height_m: Height of the labelled stem above the ground at its axis, m. The keypoint
            ``axis_top`` is at half of it, ``axis_middle`` halfway between the cut and ``axis_top``.
        cut_height_m: Height of the felling cut above the ground on the uphill side, m.
        diameter_height_m: Height of the diameter keypoints above that ground, m.
        min_visible_fraction: Minimum visible fraction of the stem's silhouette in the frame.
        min_visible_area: Minimum visible area of the stem, as a fraction of the image.
        cut_rule: ``fixed`` uses the two heights above; ``visible`` cuts above the root flare and
            obstacles, as in ``scene.felling_cut``.

    Raises:
        SettingsError: If a value is out of range.
    """

    reach_m: float = 10.0
    stem_height_m: float = 4.0
    cut_height_m: float = 0.20
    diameter_height_m: float = 0.30
    min_visible_fraction: float = 0.08
    min_visible_area: float = 4e-4
    cut_rule: str = field(default="fixed", metadata=OMIT_DEFAULT)

    def __post_init__(self) -> None:
        check_choice("cut_rule", self.cut_rule, CUT_RULES)
        if not 0 < self.cut_height_m < self.diameter_height_m < self.stem_height_m / 4:
            raise SettingsError(
                f"cut_height_m, diameter_height_m and stem_height_m are {self.cut_height_m},"
                f" {self.diameter_height_m} and {self.stem_height_m}: expected"
                " 0 < cut_height_m < diameter_height_m < stem_height_m / 4"
            )
        check_number("reach_m", self.reach_m, 1.0, 40.0)
        check_number("stem_height_m", self.stem_height_m, 1.0, 12.0)
        check_number("min_visible_fraction", self.min_visible_fraction, 0.0, 1.0)
        check_number("min_visible_area", self.min_visible_area, 0.0, 1.0)


@dataclass(frozen=True)
class SplitSettings:
    """Split of the scenes; those not held out are for training.

    Attributes:
        val: Fraction of the scenes for validation.
        test: Fraction of the scenes for test.

    Raises:
        SettingsError: If a value is out of range, or the sum is above 1.
    """

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
    """All settings of the simulator. With a seed they determine every pixel of a dataset.

    Attributes:
        terrain: The ground.
        stand: The trees.
        undergrowth: The undergrowth.
        weather: The weather.
        light: The light.
        camera: The camera and how it is carried.
        rgb: The colour sensor.
        depth: The depth sensor.
        labels: The labels.
        splits: Train, val and test scenes.
        views_per_scene: Frames per scene.
        clutter: Clutter beyond the undergrowth.
        objects: Objects that are not trees.
        imaging: Camera faults.
        randomisation: Unnatural colours and textures.
        drive: Drives instead of independent views.
        vegetation: Dense grass, hedges and deep snow that hide the ground.
        photographs: Photographs on the materials.
        trap: Infrared nights and captions of camera traps.
        negatives: What is mistaken for stems, near the cameras.

    Raises:
        SettingsError: If a value is out of range.
    """

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
    clutter: ClutterSettings = field(default_factory=ClutterSettings, metadata=OMIT_DEFAULT)
    objects: ObjectSettings = field(default_factory=ObjectSettings, metadata=OMIT_DEFAULT)
    imaging: ImagingSettings = field(default_factory=ImagingSettings, metadata=OMIT_DEFAULT)
    randomisation: RandomisationSettings = field(
        default_factory=RandomisationSettings, metadata=OMIT_DEFAULT
    )
    drive: DriveSettings = field(default_factory=DriveSettings, metadata=OMIT_DEFAULT)
    vegetation: VegetationSettings = field(
        default_factory=VegetationSettings, metadata=OMIT_DEFAULT
    )
    photographs: PhotographSettings = field(
        default_factory=PhotographSettings, metadata=OMIT_DEFAULT
    )
    trap: TrapSettings = field(default_factory=TrapSettings, metadata=OMIT_DEFAULT)
    negatives: NegativeSettings = field(default_factory=NegativeSettings, metadata=OMIT_DEFAULT)

    def __post_init__(self) -> None:
        check_number("views_per_scene", self.views_per_scene, 1, 1000)

    def to_dict(self) -> dict[str, Any]:
        """Convert to values that JSON can hold.

        Settings marked with OMIT_DEFAULT are omitted at their default, so that older datasets keep
        the hash of their settings.
        """
        values = _record(self)
        values["camera"]["intrinsics"] = self.camera.intrinsics.to_dict()
        return values


def _record(node: Any) -> dict[str, Any]:
    """Convert a dataclass to nested dictionaries."""
    values = {}
    for entry in dataclasses.fields(node):
        value = getattr(node, entry.name)
        if entry.metadata.get("omit_default") and value == _default(entry):
            continue
        known = dataclasses.is_dataclass(value) and not isinstance(value, PinholeCamera)
        values[entry.name] = _record(value) if known else value
    return values


def _default(entry: dataclasses.Field[Any]) -> Any:
    factory = entry.default_factory
    return entry.default if factory is dataclasses.MISSING else factory()
