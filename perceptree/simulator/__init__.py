"""The forest simulator: makes labelled colour and depth frames from settings and a seed."""

from perceptree.simulator.dataset.generate import SynthReport, generate_dataset
from perceptree.simulator.settings import (
    CameraSettings,
    DepthSettings,
    LabelSettings,
    LightSettings,
    PoseSettings,
    RgbSettings,
    SimulatorSettings,
    SplitSettings,
    StandSettings,
    TerrainSettings,
    UndergrowthSettings,
    WeatherSettings,
    ideal_camera,
)
from perceptree.simulator.settings.presets import PRESETS, Preset

__all__ = [
    "PRESETS",
    "CameraSettings",
    "DepthSettings",
    "LabelSettings",
    "LightSettings",
    "PoseSettings",
    "Preset",
    "RgbSettings",
    "SimulatorSettings",
    "SplitSettings",
    "StandSettings",
    "SynthReport",
    "TerrainSettings",
    "UndergrowthSettings",
    "WeatherSettings",
    "generate_dataset",
    "ideal_camera",
]
