"""Named settings, each with its seed and number of frames."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from perceptree.simulator.settings.atmosphere import LightSettings, WeatherSettings
from perceptree.simulator.settings.drive import DriveSettings
from perceptree.simulator.settings.field import field_settings, former_field_settings
from perceptree.simulator.settings.files import FileSettings
from perceptree.simulator.settings.forest import StandSettings, TerrainSettings
from perceptree.simulator.settings.sensors import (
    CameraSettings,
    DepthSettings,
    PoseSettings,
    RgbSettings,
)
from perceptree.simulator.settings.tree import SimulatorSettings, SplitSettings
from perceptree.simulator.settings.vegetation import VegetationSettings


@dataclass(frozen=True)
class Preset:
    """A named dataset.

    Attributes:
        name: Name of the preset.
        settings: Settings of the simulator.
        seed: Seed of the dataset.
        frames: Number of frames.
        description: One line for the command line's help.
        files: File formats.
    """

    name: str
    settings: SimulatorSettings
    seed: int
    frames: int
    description: str
    files: FileSettings = field(default_factory=FileSettings)


def _paper() -> SimulatorSettings:
    """All grounds, weathers and lights, split 40k : 1k : 2k like SynthTree43k (Grondin 2022).

    Exact depth has reduced resolution and range, and JPEG a reduced quality, so that the files of
    a frame take at most 700 kB on average.
    """
    return SimulatorSettings(
        rgb=RgbSettings(jpeg_quality=80),
        depth=DepthSettings(exact_range_m=15.0, exact_stride_px=2),
        splits=SplitSettings(val=1 / 43, test=2 / 43),
    )


def _plain() -> SimulatorSettings:
    """Clear days on one ground, firs and beeches on gentle slopes, carried by hand."""
    carried = PoseSettings((1.4, 2.6), (-14.0, 2.0), (-4.0, 4.0))
    return SimulatorSettings(
        terrain=TerrainSettings(slope_deg=(0.0, 12.0), grounds={"litter": 1.0}),
        stand=StandSettings(
            patterns={"random": 1.0}, species={"fir": 3.0, "beech": 2.0}, species_per_scene=2
        ),
        weather=WeatherSettings(kinds={"clear": 1.0}),
        light=LightSettings(times={"daylight": 1.0}, overcast_share=0.0),
        camera=CameraSettings(mast=carried, hand=carried),
    )


def _field() -> SimulatorSettings:
    """The paper's conditions with additions for real forests, for networks to be deployed."""
    return replace(field_settings(_paper()), splits=SplitSettings(val=0.05, test=0.05))


def _former_field() -> SimulatorSettings:
    """The field mix as it was when `field-test` was frozen."""
    return replace(former_field_settings(_paper()), splits=SplitSettings(val=0.05, test=0.05))


def _drive() -> SimulatorSettings:
    """One-minute drives at 10 frames per second, each through another scene of the former mix."""
    return replace(
        _former_field(),
        drive=DriveSettings(rate_hz=10.0),
        views_per_scene=600,
        splits=SplitSettings(val=0.0, test=1.0),
    )


def _vegetation() -> SimulatorSettings:
    """The former field mix with cover that hides the ground and the feet of stems."""
    cover = VegetationSettings(
        grass_share=0.7,
        grass_cover=(0.5, 0.95),
        grass_height_m=(0.1, 0.5),
        hedge_share=0.2,
        snow_depth_m=(0.05, 0.4),
    )
    return replace(_former_field(), vegetation=cover)


_ALL = (
    Preset(
        "paper",
        _paper(),
        1,
        43_000,
        "the paper's mix of every ground, weather and light",
    ),
    Preset(
        "test",
        replace(_paper(), splits=SplitSettings(val=0.0, test=1.0), depth=DepthSettings()),
        44,
        400,
        "the frozen test set that accuracy is measured on, of the paper's mix",
    ),
    Preset("field", _field(), 3, 10_000, "what real pictures hold, for networks to be deployed"),
    Preset("vegetation", _vegetation(), 5, 10_000, "field, with the ground under grass and snow"),
    Preset("drive", _drive(), 4, 600, "a machine's drives through the field mix, with an IMU"),
    Preset(
        "field-test",
        replace(
            _former_field(),
            splits=SplitSettings(val=0.0, test=1.0),
            depth=DepthSettings(in_haze=True),
        ),
        45,
        400,
        "the second frozen test set, of the field mix",
    ),
    Preset("plain", _plain(), 2, 1_000, "clear days on one ground, firs and beeches"),
)
PRESETS: dict[str, Preset] = {preset.name: preset for preset in _ALL}
