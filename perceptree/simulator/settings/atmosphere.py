"""Settings of weather and light."""

from __future__ import annotations

from dataclasses import dataclass, field

from perceptree.simulator.settings.checks import (
    OMIT_DEFAULT,
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
    """Weather of the scenes.

    Attributes:
        kinds: Weight of each of WEATHERS. ``snow`` is lying snow; ``snowfall`` is flakes in the
            air and some lying snow; ``wet`` is surfaces after rain; ``rain`` is streaks in the air
            and wet surfaces; ``fog`` is dense haze.
        strength: Range of the strength, 0 (hardly) to 1 (severe).

    Raises:
        SettingsError: If a value is out of range.
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
    """Light of the scenes.

    Attributes:
        times: Weight of each of TIMES, which decide the sun's height, strength and colour. At
            night a lamp at the camera lights the surroundings.
        overcast_share: Fraction of scenes with an overcast sky.
        sun_warmth: Saturation of the sun's colour: 1 is the natural colour, 0 is white.

    Raises:
        SettingsError: If a value is out of range.
    """

    times: Shares = field(
        default_factory=lambda: {"morning": 1.0, "daylight": 2.0, "evening": 1.0, "dusk": 1.0}
    )
    overcast_share: float = 0.25
    sun_warmth: float = field(default=1.0, metadata=OMIT_DEFAULT)

    def __post_init__(self) -> None:
        check_shares("light times", self.times, TIMES)
        check_range("overcast_share", (self.overcast_share, self.overcast_share), 0.0, 1.0)
        check_number("sun_warmth", self.sun_warmth, 0.0, 1.0)
