"""Falling rain and snow between the camera and the scene."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Float, Float32, UInt8
from calib import CAMERA_UP, PinholeCamera, project_points
from perceptree.simulator.sensors.kernels import draw_particles

_NEAREST_M = 0.4
_FARTHEST_M = 15.0
_DROPS = 16000  # number of drops in view at full strength
_FLAKES = 18000  # number of flakes in view at full strength
_EXPOSURE_S = 1 / 90
_FLAKE_EXPOSURE_S = 1 / 250
_RAIN_OPACITY = 0.65
_FLAKE_OPACITY = 0.95
_WIND_M_PER_S = 2.5
_APERTURE_M = 0.010
_FOCUS_M = 5.0
_LIGHT_PERCENTILE = 88.0  # of the image's grey levels, for the colour of particles


@dataclass(frozen=True)
class _Particles:
    """Raindrops or snowflakes.

    Attributes:
        position_m: (N, 3) in camera axes, m.
        velocity: (N, 3) in camera axes, m/s.
        diameter_m: (N,) m.
        exposure_s: Exposure time, s, which decides the length of the streaks.
        opacity: Opacity of a particle in focus, 0 to 1.
    """

    position_m: Float
    velocity: Float
    diameter_m: Float
    exposure_s: float
    opacity: float


def _positions(rng: np.random.Generator, camera: PinholeCamera, count: int) -> Float:
    """(N, 3) random points in view, farthest first, m.

    Their density decreases with distance, because distant particles cannot be told from haze.
    """
    z = -np.sort(-np.sqrt(rng.uniform(_NEAREST_M**2, _FARTHEST_M**2, count)))
    size, focal = (camera.width, camera.height), (camera.fx, camera.fy)
    across_px = rng.uniform(-0.55, 0.55, (count, 2)) * size + np.subtract(size, 1) / 2
    across = (across_px - (camera.cx, camera.cy)) / focal
    return np.column_stack([across * z[:, None], z])


def _wind(rng: np.random.Generator, up: Float) -> Float:
    """(3,) random horizontal wind, m/s."""
    wind = rng.normal(0, _WIND_M_PER_S / np.sqrt(2), 3)
    return np.asarray(wind - up * (wind @ up))


def _rain(
    rng: np.random.Generator, camera: PinholeCamera, strength: float, up: Float
) -> _Particles:
    """Drops of 1 to 3.5 mm at terminal speed, 9.65 - 10.3 exp(-0.6 D / mm) m/s (Atlas 1973)."""
    position = _positions(rng, camera, round(_DROPS * strength))
    diameter_mm = 1 + np.minimum(rng.exponential(0.3 + 0.4 * strength, len(position)), 2.5)
    speed = 9.65 - 10.3 * np.exp(-0.6 * diameter_mm)
    swirl = rng.normal(0, 0.25, (len(position), 3))
    velocity = _wind(rng, up) + swirl - up * speed[:, None]
    return _Particles(position, velocity, diameter_mm / 1000, _EXPOSURE_S, _RAIN_OPACITY)


def _snow(
    rng: np.random.Generator, camera: PinholeCamera, strength: float, up: Float
) -> _Particles:
    """Flakes of 3 to 17 mm that fall at about 1 m/s with turbulence."""
    position = _positions(rng, camera, round(_FLAKES * strength))
    diameter_mm = 3 + np.minimum(rng.exponential(2 + 2 * strength, len(position)), 14)
    swirl = rng.normal(0, 0.3, (len(position), 3))
    velocity = 0.5 * _wind(rng, up) + swirl - up * rng.uniform(0.7, 1.6, (len(position), 1))
    return _Particles(position, velocity, diameter_mm / 1000, _FLAKE_EXPOSURE_S, _FLAKE_OPACITY)


def _light(image: UInt8) -> Float32:
    """(3,) BGR colour of the particles: nearly grey, from the bright parts of the image."""
    small = cv2.resize(image, (64, 36), interpolation=cv2.INTER_AREA).reshape(-1, 3)
    bright = np.percentile(small, _LIGHT_PERCENTILE, axis=0)
    grey = max(float(bright.mean()), 40.0)
    return np.asarray(np.minimum(1.5 * (0.85 * grey + 0.15 * bright), 232.0), np.float32)


def _draw(
    image: UInt8,
    depth_m: Float32,
    camera: PinholeCamera,
    particles: _Particles,
) -> None:
    """Draw the paths of particles during the exposure, with defocus.

    Particles smaller than a pixel or out of focus are drawn with less opacity.
    """
    z = particles.position_m[:, 2]
    half_path = 0.5 * particles.exposure_s * particles.velocity
    ends = np.stack([particles.position_m - half_path, particles.position_m + half_path], 1)
    ends[..., 2] = np.maximum(ends[..., 2], 0.5 * _NEAREST_M)
    sharp = 0.5 * camera.fx * particles.diameter_m / z
    blurred = 0.5 * camera.fx * _APERTURE_M * np.abs(1 / z - 1 / _FOCUS_M)
    soft = np.maximum(np.minimum(blurred, 10.0), 0.6)
    radius = np.maximum(sharp, 0.35)
    thin = np.minimum(sharp / radius, 1.0) * np.sqrt(np.minimum(2 * radius / soft, 1.0))
    draw_particles(
        image,
        depth_m,
        project_points(camera, ends).astype(np.float32),
        z.astype(np.float32),
        radius.astype(np.float32),
        soft.astype(np.float32),
        (particles.opacity * thin).astype(np.float32),
        _light(image),
    )


def draw_precipitation(
    rng: np.random.Generator,
    image: UInt8,
    depth_m: Float32,
    camera: PinholeCamera,
    rain: float,
    snowfall: float,
    up: ArrayLike = CAMERA_UP,
) -> UInt8:
    """Draw rain and snowflakes at distances of 0.4 to 15 m.

    Args:
        rng: Source of random numbers.
        image: (H, W, 3) uint8 BGR.
        depth_m: (H, W) exact depth, m; 0 on sky. Particles behind a surface are hidden.
        camera: Intrinsics of the image.
        rain: Strength of the rain, 0 to 1.
        snowfall: Strength of the snowfall, 0 to 1.
        up: (3,) unit vector upwards in camera axes.

    Returns:
        A changed copy of `image`.
    """
    drawn, upwards = image.copy(), np.asarray(up, np.float64)
    if rain > 0:
        _draw(drawn, depth_m, camera, _rain(rng, camera, rain, upwards))
    if snowfall > 0:
        _draw(drawn, depth_m, camera, _snow(rng, camera, snowfall, upwards))
    return drawn
