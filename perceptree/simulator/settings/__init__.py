"""Settings of the simulator, one dataclass per topic.

All of them are checked when they are built, and raise SettingsError if a value is out of range.
"""

from perceptree.simulator.settings.atmosphere import (
    TIMES,
    WEATHERS,
    LightSettings,
    WeatherSettings,
)
from perceptree.simulator.settings.drive import DriveSettings
from perceptree.simulator.settings.forest import (
    GROUNDS,
    PATTERNS,
    SPECIES,
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
from perceptree.simulator.settings.sensors import (
    DEPTH_KINDS,
    CameraSettings,
    DepthSettings,
    PoseSettings,
    RgbSettings,
    ideal_camera,
)
from perceptree.simulator.settings.trap import TrapSettings
from perceptree.simulator.settings.tree import LabelSettings, SimulatorSettings, SplitSettings
from perceptree.simulator.settings.vegetation import VegetationSettings

__all__ = [
    "DEPTH_KINDS",
    "GROUNDS",
    "PATTERNS",
    "SPECIES",
    "TIMES",
    "WEATHERS",
    "CameraSettings",
    "ClutterSettings",
    "DepthSettings",
    "DriveSettings",
    "ImagingSettings",
    "LabelSettings",
    "LightSettings",
    "NegativeSettings",
    "ObjectSettings",
    "PhotographSettings",
    "PoseSettings",
    "RandomisationSettings",
    "RgbSettings",
    "SimulatorSettings",
    "SplitSettings",
    "StandSettings",
    "TerrainSettings",
    "TrapSettings",
    "UndergrowthSettings",
    "VegetationSettings",
    "WeatherSettings",
    "ideal_camera",
]
