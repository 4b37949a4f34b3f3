"""Weather and light of a scene: what is drawn once and holds for all its views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.settings import TIMES, WEATHERS, LightSettings, WeatherSettings

Float = NDArray[np.floating[Any]]

_CLEAR_AIR_PER_M = (0.001, 0.005)
_FOG_PER_M = (0.015, 0.065)


@dataclass(frozen=True)
class Weather:
    """A kind of WEATHERS with its strength, and what it does: 0 none, 1 full, haze per metre."""

    kind: str
    strength: float
    snow: float
    wet: float
    rain: float
    snowfall: float
    haze_per_m: float


@dataclass(frozen=True)
class Light:
    """Sun and sky at one of TIMES.

    ``sun`` (3,) unit vector towards it; colours (3,) linear RGB; ``darkness`` from 0 (day) to 1
    (dusk), which the camera answers with gain; ``lamp`` the strength of a lamp at the camera.
    """

    time: str
    overcast: bool
    sun: Float
    sun_colour: Float
    sky_colour: Float
    haze_colour: Float
    darkness: float
    lamp: float = 0.0


@dataclass(frozen=True)
class _Sky:
    """What a time of day looks like: ranges to draw from, colours linear RGB."""

    elevation_deg: tuple[float, float]
    sun_strength: tuple[float, float]
    sun_colour: tuple[float, float, float]
    sky_colour: tuple[float, float, float]
    darkness: float


_SKIES = {
    "morning": _Sky((8.0, 26.0), (2.5, 5.5), (1.0, 0.74, 0.45), (0.50, 0.58, 0.70), 0.15),
    "daylight": _Sky((30.0, 65.0), (3.0, 7.5), (1.0, 0.90, 0.76), (0.52, 0.63, 0.80), 0.0),
    "evening": _Sky((5.0, 18.0), (2.5, 5.5), (1.0, 0.50, 0.20), (0.56, 0.50, 0.56), 0.3),
    "dusk": _Sky((2.0, 8.0), (0.0, 0.45), (1.0, 0.55, 0.40), (0.34, 0.40, 0.62), 1.0),
    "night": _Sky((20.0, 70.0), (0.0, 0.03), (0.8, 0.9, 1.0), (0.006, 0.008, 0.013), 1.0),
}
_LAMP = (3.0, 40.0)


def _draw(rng: np.random.Generator, weights: dict[str, float], known: tuple[str, ...]) -> str:
    shares = np.array([weights.get(name, 0.0) for name in known])
    return known[rng.choice(len(known), p=shares / shares.sum())]


def make_weather(rng: np.random.Generator, settings: WeatherSettings) -> Weather:
    """Draw the scene's weather; falling snow lies too, and rain wets."""
    kind = _draw(rng, settings.kinds, WEATHERS)
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
    """Draw the time of day; clouds, fog and anything that falls take the sun's share."""
    time = _draw(rng, settings.times, TIMES)
    sky = _SKIES[time]
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
