"""The forest simulator: labelled colour and depth frames from a seed and settings."""

from perceptree.simulator.generate import SynthReport, generate_dataset, simulate_frames
from perceptree.simulator.settings import (
    CameraSettings,
    LabelSettings,
    LightSettings,
    SensorSettings,
    SimulatorSettings,
    StandSettings,
)

__all__ = [
    "CameraSettings",
    "LabelSettings",
    "LightSettings",
    "SensorSettings",
    "SimulatorSettings",
    "StandSettings",
    "SynthReport",
    "generate_dataset",
    "simulate_frames",
]
