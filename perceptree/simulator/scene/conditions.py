"""Weather and light of a scene, the same in all its views."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.settings import TIMES, WEATHERS, LightSettings, WeatherSettings
from perceptree.simulator.streams import choose

# Ranges of the extinction. By Koschmieder (1924) the visibility is 3.9 over it: 0.8 to 4 km in
# clear air, 60 to 260 m in fog.
_CLEAR_AIR_PER_M = (0.001, 0.005)
_FOG_PER_M = (0.015, 0.065)


@dataclass(frozen=True)
class Weather:
    """The weather of a scene.

    Attributes:
        kind: One of WEATHERS.
        strength: 0 (hardly) to 1 (severe).
        snow: Amount of lying snow, 0 to 1.
        wet: Wetness of surfaces, 0 to 1.
        rain: Strength of falling rain, 0 to 1.
        snowfall: Strength of falling snow, 0 to 1.
        haze_per_m: Extinction of the air, 1/m.
    """

    kind: str
    strength: float
    snow: float
    wet: float
    rain: float
    snowfall: float
    haze_per_m: float


@dataclass(frozen=True)
class Light:
    """The light of a scene.

    Attributes:
        time: One of TIMES.
        overcast: Whether clouds hide the sun.
        sun: (3,) unit vector towards the sun.
        sun_colour: (3,) linear RGB.
        sky_colour: (3,) linear RGB.
        haze_colour: (3,) linear RGB.
        darkness: 0 (day) to 1 (dusk); the camera compensates it by gain, with more noise.
        lamp: Strength of a lamp at the camera, 0 for none.
        infrared: Whether the lamp is infrared.
    """

    time: str
    overcast: bool
    sun: Float
    sun_colour: Float
    sky_colour: Float
    haze_colour: Float
    darkness: float
    lamp: float = 0.0
    infrared: bool = False


@dataclass(frozen=True)
class _TimeOfDay:
    """Sun and sky of a time of day. Colours are linear RGB, ranges are drawn from.

    The values were chosen by eye.
    """

    elevation_deg: tuple[float, float]
    sun_strength: tuple[float, float]
    sun_colour: tuple[float, float, float]
    sky_colour: tuple[float, float, float]
    darkness: float


_TIMES_OF_DAY = {
    "morning": _TimeOfDay((8.0, 26.0), (2.5, 5.5), (1.0, 0.74, 0.45), (0.50, 0.58, 0.70), 0.15),
    "daylight": _TimeOfDay((30.0, 65.0), (3.0, 7.5), (1.0, 0.90, 0.76), (0.52, 0.63, 0.80), 0.0),
    "evening": _TimeOfDay((5.0, 18.0), (2.5, 5.5), (1.0, 0.50, 0.20), (0.56, 0.50, 0.56), 0.3),
    "dusk": _TimeOfDay((2.0, 8.0), (0.0, 0.45), (1.0, 0.55, 0.40), (0.34, 0.40, 0.62), 1.0),
    "night": _TimeOfDay((20.0, 70.0), (0.0, 0.03), (0.8, 0.9, 1.0), (0.006, 0.008, 0.013), 1.0),
}
_LAMP = (3.0, 40.0)  # range of the lamp's strength at night
_INFRARED_SKY = (0.0001, 0.0012)  # ambient light over that of the infrared lamp at 1 m
_INFRARED_SCATTER_M = (0.1, 0.4)  # light that the air throws back, over extinction and lamp


def make_weather(rng: np.random.Generator, settings: WeatherSettings) -> Weather:
    """Draw the weather of a scene.

    Snowfall comes with lying snow, and rain with wet surfaces.

    Args:
        rng: Source of random numbers.
        settings: Weights of the kinds, and range of the strength.
    """
    kind = choose(rng, settings.kinds, WEATHERS)
    strength = float(rng.uniform(*settings.strength))
    haze = float(rng.uniform(*_CLEAR_AIR_PER_M))
    if kind == "fog":
        haze = _FOG_PER_M[0] + (_FOG_PER_M[1] - _FOG_PER_M[0]) * strength**2
    elif kind in ("rain", "snowfall"):
        haze += 0.012 * strength
    snow = {"snow": strength, "snowfall": rng.uniform(0.1, 1.0) * strength}.get(kind, 0.0)
    wet = {"wet": strength, "rain": rng.uniform(0.5, 1.0)}.get(kind, 0.0)
    rain = strength if kind == "rain" else 0.0
    return Weather(
        kind,
        0.0 if kind == "clear" else strength,
        float(snow),
        float(wet),
        rain,
        strength if kind == "snowfall" else 0.0,
        float(haze),
    )


def make_light(rng: np.random.Generator, settings: LightSettings, weather: Weather) -> Light:
    """Draw the light of a scene. Clouds, fog, rain and snowfall weaken the sun.

    Args:
        rng: Source of random numbers.
        settings: Weights of the times of day, and fraction of overcast scenes.
        weather: Weather of the scene.
    """
    time = choose(rng, settings.times, TIMES)
    sky = _TIMES_OF_DAY[time]
    elevation, azimuth = np.radians(rng.uniform(*sky.elevation_deg)), rng.uniform(0, 2 * np.pi)
    across = np.cos(elevation)
    sun = np.array([across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)])
    strength = rng.uniform(*sky.sun_strength)
    drawn = rng.random() < settings.overcast_share
    overcast = bool(drawn or weather.kind in ("rain", "snowfall"))
    if weather.kind == "fog":
        strength *= 1 - 0.9 * weather.strength
    sun_colour = (0.08 if overcast else 1.0) * strength * np.array(sky.sun_colour)
    if settings.sun_warmth != 1:
        sun_colour = sun_colour.mean() + settings.sun_warmth * (sun_colour - sun_colour.mean())
    sky_colour = np.array(sky.sky_colour) * rng.uniform(0.85, 1.2)
    if overcast:
        sky_colour = 0.55 * sky_colour + 0.45 * sky_colour.mean()
    haze_colour = sky_colour * rng.uniform(0.18, 0.34)
    if weather.kind in ("fog", "rain", "snowfall"):
        brightness = (0.4, 0.7) if weather.kind == "fog" else (0.26, 0.42)
        haze_colour = (0.6 * sky_colour + 0.4 * sky_colour.mean()) * rng.uniform(*brightness)
    lamp = float(rng.uniform(*_LAMP)) if time == "night" else 0.0
    return Light(time, overcast, sun, sun_colour, sky_colour, haze_colour, sky.darkness, lamp)


def infrared_light(rng: np.random.Generator, light: Light, weather: Weather) -> Light:
    """Turn the light of a scene into a night with an infrared lamp of strength 1.

    Args:
        rng: Source of random numbers.
        light: Light of the scene.
        weather: Weather of the scene.
    """
    return replace(
        light,
        time="night",
        sun_colour=np.zeros(3),
        sky_colour=np.full(3, rng.uniform(*_INFRARED_SKY)),
        haze_colour=np.full(3, rng.uniform(*_INFRARED_SCATTER_M) * weather.haze_per_m),
        darkness=1.0,
        lamp=1.0,
        infrared=True,
    )
