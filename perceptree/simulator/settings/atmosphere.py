"""Settings of weather and light."""

from __future__ import annotations

from dataclasses import dataclass, field

from basetree.settings import Settings, label, weights
from perceptree.simulator.settings.checks import OMIT_DEFAULT, Range, Shares, number

WEATHERS = ("clear", "snow", "wet", "fog", "rain", "snowfall")
TIMES = ("morning", "daylight", "evening", "dusk", "night")


@dataclass(frozen=True)
class WeatherSettings(Settings):
    """Weather of the scenes."""

    kinds: Shares = field(
        default_factory=lambda: dict.fromkeys(WEATHERS, 1.0) | {"clear": 4.0},
        metadata=weights(WEATHERS) | label("weather kinds"),
    )
    """Weight of each of WEATHERS. `snow` is lying snow; `snowfall` is flakes in the air and
    some lying snow; `wet` is surfaces after rain; `rain` is streaks in the air and wet
    surfaces; `fog` is dense haze."""
    strength: Range = field(default=(0.2, 1.0), metadata=number(0, 1) | label("weather strength"))
    """Range of the strength, 0 (hardly) to 1 (severe)."""


@dataclass(frozen=True)
class LightSettings(Settings):
    """Light of the scenes."""

    times: Shares = field(
        default_factory=lambda: {"morning": 1.0, "daylight": 2.0, "evening": 1.0, "dusk": 1.0},
        metadata=weights(TIMES) | label("light times"),
    )
    """Weight of each of TIMES, which decide the sun's height, strength and colour. At night a lamp
    at the camera lights the surroundings."""
    overcast_share: float = field(default=0.25, metadata=number(0, 1))
    """Fraction of scenes with an overcast sky."""
    sun_warmth: float = field(default=1.0, metadata=number(0, 1) | OMIT_DEFAULT)
    """Saturation of the sun's colour: 1 is the natural colour, 0 is white."""
