"""Settings of weather and light."""

from __future__ import annotations

from dataclasses import dataclass, field

from perceptree.simulator.settings.checks import (
    LATER,
    Range,
    Shares,
    check_number,
    check_range,
    check_shares,
)

WEATHERS = ("clear", "snow", "wet", "fog", "rain", "snowfall")
TIMES = ("morning", "daylight", "evening", "dusk", "night")


@dataclass(frozen=True)
class WeatherSettings:
    """Which weather a scene has, and how strong it is, from 0 (hardly) to 1 (severe).

    ``snow`` is lying snow; ``snowfall`` flakes in the air over some lying snow; ``wet`` surfaces
    after rain; ``rain`` streaks in the air over wet surfaces; ``fog`` dense air.
    """

    kinds: Shares = field(
        default_factory=lambda: {
            "clear": 4.0,
            "snow": 1.0,
            "wet": 1.0,
            "fog": 1.0,
            "rain": 1.0,
            "snowfall": 1.0,
        }
    )
    strength: Range = (0.2, 1.0)

    def __post_init__(self) -> None:
        check_shares("weather kinds", self.kinds, WEATHERS)
        check_range("weather strength", self.strength, 0.0, 1.0)


@dataclass(frozen=True)
class LightSettings:
    """Which time of day a scene has: it decides the sun's height, strength and colour.

    At night a lamp at the camera lights what is near. ``sun_warmth`` is how far the sun's colour
    lies from white: 1 as strong as at that hour, 0 not at all.
    """

    times: Shares = field(
        default_factory=lambda: {"morning": 1.0, "daylight": 2.0, "evening": 1.0, "dusk": 1.0}
    )
    overcast_share: float = 0.25
    sun_warmth: float = field(default=1.0, metadata=LATER)

    def __post_init__(self) -> None:
        check_shares("light times", self.times, TIMES)
        check_range("overcast_share", (self.overcast_share, self.overcast_share), 0.0, 1.0)
        check_number("sun_warmth", self.sun_warmth, 0.0, 1.0)
