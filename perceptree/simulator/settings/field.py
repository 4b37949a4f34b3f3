"""The `field` settings: the paper's settings with groups of additions for real forests.

Each group can be added alone, to measure its effect (`benchmarks/field.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from perceptree.simulator.settings.atmosphere import LightSettings, WeatherSettings
from perceptree.simulator.settings.forest import StandSettings, TerrainSettings
from perceptree.simulator.settings.realism import (
    ClutterSettings,
    ImagingSettings,
    NegativeSettings,
    ObjectSettings,
    RandomisationSettings,
)
from perceptree.simulator.settings.sensors import RgbSettings
from perceptree.simulator.settings.trap import TrapSettings
from perceptree.simulator.settings.tree import LabelSettings, SimulatorSettings


def _scene(settings: SimulatorSettings) -> SimulatorSettings:
    """Denser stands with thicker stems, distant forest, clutter at stems, dense low plants."""
    return replace(
        settings,
        terrain=TerrainSettings(roughness_m=(0.01, 0.05)),
        stand=StandSettings(
            stems_per_ha=(250.0, 1300.0),
            max_neighbours=12,
            spacing_m=0.8,
            diameter_m=(0.05, 0.9),
            diameter_median_m=(0.12, 0.36),
            lean_std_deg=(1.0, 8.0),
            dead_share=0.08,
            fine_crowns=True,
        ),
        clutter=ClutterSettings(
            dead_twigs=(0.0, 3.0),
            herbs=(0.0, 1.0),
            shrubs=(0.0, 0.8),
            foot=(0.1, 0.9),
            backdrop=(0.3, 1.0),
        ),
    )


def _camera(settings: SimulatorSettings) -> SimulatorSettings:
    """More daylight and mild weather, as machines work in, nights, and camera faults."""
    kinds = {"clear": 5.0, "snow": 1.0, "wet": 1.0, "fog": 0.7, "rain": 0.7, "snowfall": 0.6}
    times = {"morning": 1.5, "daylight": 3.0, "evening": 1.0, "dusk": 0.6, "night": 0.5}
    return replace(
        settings,
        weather=WeatherSettings(kinds=kinds, strength=(0.1, 0.8)),
        light=LightSettings(times=times, overcast_share=0.3, sun_warmth=0.55),
        rgb=RgbSettings(
            exposure=(0.6, 2.2),
            blur_px=(0.0, 0.6),
            motion_px=(0.0, 8.0),
            jpeg_quality=85,
            dusk_exposure=0.85,
        ),
        depth=replace(settings.depth, in_haze=True),
        imaging=ImagingSettings(
            share=0.7, exposure_stops=(-1.0, 1.2), infrared_share=0.06, saturation=(1.0, 2.2)
        ),
    )


def _objects(settings: SimulatorSettings) -> SimulatorSettings:
    """Objects that are not trees."""
    return replace(
        settings,
        objects=ObjectSettings(
            people=(0.0, 2.0),
            animals=(0.0, 1.5),
            machines=(0.0, 0.8),
            posts=(0.0, 3.0),
            logs=(0.0, 4.0),
            walls=(0.0, 1.2),
            shapes=(0.0, 4.0),
        ),
    )


def _colours(settings: SimulatorSettings) -> SimulatorSettings:
    """Unnatural colours and textures."""
    return replace(settings, randomisation=RandomisationSettings(recolour=0.2, swap=0.02, sky=0.08))


def _trap(settings: SimulatorSettings) -> SimulatorSettings:
    """Nights as infrared camera traps see them, and captions by day and night."""
    return replace(settings, trap=TrapSettings(infrared_share=0.22, caption_share=0.25))


def _negatives(settings: SimulatorSettings) -> SimulatorSettings:
    """What is mistaken for stems near the camera, and more objects of all kinds."""
    return replace(
        settings,
        objects=ObjectSettings(
            people=(0.0, 4.0),
            animals=(0.0, 5.0),
            machines=(0.0, 0.9),
            posts=(0.0, 6.0),
            logs=(0.0, 5.0),
            walls=(0.0, 1.3),
            shapes=(0.0, 7.0),
        ),
        negatives=NegativeSettings(
            people=(0.0, 0.8),
            animals=(0.0, 0.8),
            posts=(0.0, 0.9),
            logs=(0.0, 1.2),
            stumps=(0.0, 0.8),
            twigs=(0.0, 0.65),
            thickets=(0.0, 2.5),
        ),
    )


_Group = Callable[[SimulatorSettings], SimulatorSettings]
_FORMER_GROUPS: dict[str, _Group] = {
    "scene": _scene,
    "camera": _camera,
    "objects": _objects,
    "colours": _colours,
}
FIELD_GROUPS: dict[str, _Group] = _FORMER_GROUPS | {"trap": _trap, "negatives": _negatives}


def with_groups(start: SimulatorSettings, groups: Iterable[str]) -> SimulatorSettings:
    """Add groups of additions to settings.

    Args:
        start: Settings to start from.
        groups: Keys of FIELD_GROUPS, applied in this order.
    """
    for group in groups:
        start = FIELD_GROUPS[group](start)
    return start


def field_settings(paper: SimulatorSettings) -> SimulatorSettings:
    """Add all groups to the paper's settings, with felling cuts above obstacles."""
    return _finished(with_groups(paper, FIELD_GROUPS))


def former_field_settings(paper: SimulatorSettings) -> SimulatorSettings:
    """The field mix before infrared nights and negatives, which other presets hold on to."""
    return _finished(with_groups(paper, _FORMER_GROUPS))


def _finished(settings: SimulatorSettings) -> SimulatorSettings:
    return replace(settings, labels=LabelSettings(cut_rule="visible"), views_per_scene=4)
