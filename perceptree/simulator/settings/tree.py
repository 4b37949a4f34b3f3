"""All settings of a simulated dataset in one nested dataclass, which is stored with the frames."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from basetree.settings import Settings, names
from calib import PinholeCamera
from perceptree.simulator.settings.atmosphere import LightSettings, WeatherSettings
from perceptree.simulator.settings.checks import OMIT_DEFAULT, number
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
class LabelSettings(Settings):
    """Which trees are labelled, and where their five keypoints are."""

    reach_m: float = field(default=10.0, metadata=number(1, 13))
    """Maximum distance of a labelled tree from the camera, m. Only trees within 18 m of the scene's
    centre can be labelled, and cameras stand within 6 m of it: all trees are labelled to 12 m, and
    998 of 1000 to 13 m."""
    stem_height_m: float = field(default=4.0, metadata=number(1, 12))
    """Height of the labelled stem above the ground at its axis, m. The keypoint `axis_top` is at
    half of it, `axis_middle` halfway between the cut and `axis_top`."""
    cut_height_m: float = 0.20
    """Height of the felling cut above the ground on the uphill side, m."""
    diameter_height_m: float = 0.30
    """Height of the diameter keypoints above that ground, m."""
    min_visible_fraction: float = field(default=0.08, metadata=number(0, 1))
    """Minimum visible fraction of the stem's silhouette in the frame."""
    min_visible_area: float = field(default=4e-4, metadata=number(0, 1))
    """Minimum visible area of the stem, as a fraction of the image."""
    cut_rule: str = field(default="fixed", metadata=names(CUT_RULES) | OMIT_DEFAULT)
    """`fixed` uses the two heights above; `visible` cuts above the root flare and obstacles, as
    in `scene.felling_cut`."""

    def _check_together(self) -> None:
        if not 0 < self.cut_height_m < self.diameter_height_m < self.stem_height_m / 4:
            self._refuse(
                f"cut_height_m, diameter_height_m and stem_height_m are {self.cut_height_m},"
                f" {self.diameter_height_m} and {self.stem_height_m}",
                "0 < cut_height_m < diameter_height_m < stem_height_m / 4",
            )


@dataclass(frozen=True)
class SplitSettings(Settings):
    """Split of the scenes; those not held out are for training."""

    val: float = field(default=0.1, metadata=number(0, 0.5))
    """Fraction of the scenes for validation."""
    test: float = field(default=0.1, metadata=number(0, 1))
    """Fraction of the scenes for test."""

    def _check_together(self) -> None:
        if self.val + self.test > 1:
            found = f"val and test are {self.val:g} and {self.test:g}"
            self._refuse(found, "a sum of at most 1")


@dataclass(frozen=True)
class SimulatorSettings(Settings):
    """All settings of the simulator. With a seed they determine every pixel of a dataset."""

    terrain: TerrainSettings = field(default=TerrainSettings())
    """The ground."""
    stand: StandSettings = field(default=StandSettings())
    """The trees."""
    undergrowth: UndergrowthSettings = field(default=UndergrowthSettings())
    """The undergrowth."""
    weather: WeatherSettings = field(default=WeatherSettings())
    """The weather."""
    light: LightSettings = field(default=LightSettings())
    """The light."""
    camera: CameraSettings = field(default=CameraSettings())
    """The camera and how it is carried."""
    rgb: RgbSettings = field(default=RgbSettings())
    """The colour sensor."""
    depth: DepthSettings = field(default=DepthSettings())
    """The depth sensor."""
    labels: LabelSettings = field(default=LabelSettings())
    """The labels."""
    splits: SplitSettings = field(default=SplitSettings())
    """Train, val and test scenes."""
    views_per_scene: int = field(default=8, metadata=number(1, 1000))
    """Frames per scene."""
    clutter: ClutterSettings = field(default=ClutterSettings(), metadata=OMIT_DEFAULT)
    """Clutter beyond the undergrowth."""
    objects: ObjectSettings = field(default=ObjectSettings(), metadata=OMIT_DEFAULT)
    """Objects that are not trees."""
    imaging: ImagingSettings = field(default=ImagingSettings(), metadata=OMIT_DEFAULT)
    """Camera faults."""
    randomisation: RandomisationSettings = field(
        default=RandomisationSettings(), metadata=OMIT_DEFAULT
    )
    """Unnatural colours and textures."""
    drive: DriveSettings = field(default=DriveSettings(), metadata=OMIT_DEFAULT)
    """Drives instead of independent views."""
    vegetation: VegetationSettings = field(default=VegetationSettings(), metadata=OMIT_DEFAULT)
    """Dense grass, hedges and deep snow that hide the ground."""
    photographs: PhotographSettings = field(default=PhotographSettings(), metadata=OMIT_DEFAULT)
    """Photographs on the materials."""
    trap: TrapSettings = field(default=TrapSettings(), metadata=OMIT_DEFAULT)
    """Infrared nights and captions of camera traps."""
    negatives: NegativeSettings = field(default=NegativeSettings(), metadata=OMIT_DEFAULT)
    """What is mistaken for stems, near the cameras."""

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
        if entry.metadata.get("omit_default") and value == entry.default:
            continue
        known = dataclasses.is_dataclass(value) and not isinstance(value, PinholeCamera)
        values[entry.name] = _record(value) if known else value
    return values
