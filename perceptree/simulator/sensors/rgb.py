"""Colour sensor model: from linear light to an 8-bit image with blur, noise and vignetting."""

from __future__ import annotations

from collections.abc import Callable
from statistics import NormalDist

import cv2
import numpy as np

from basetree.arrays import Float, Float32, UInt8
from perceptree.simulator.sensors.kernels import develop, tone
from perceptree.simulator.settings import RgbSettings

_MIDDLE_GREY = 0.22  # exposed light at middle grey
_CORNER_LOSS = 0.25  # vignetting: fraction of light lost at the corners
_DUSK_NOISE = 3.0  # factor of the noise at dusk
_READ_NOISE = 0.01  # variance of the read noise, in units of light
_GAMMA = 2.2
_LUT_SIZE = 4096
_LEAST_BLUR_PX = 0.2  # smaller blurs are skipped
_NORMALS = np.array([NormalDist().inv_cdf((i + 0.5) / 256) for i in range(256)], np.float32)


def _filmic(light: Float) -> Float:
    """Narkowicz's fit (2016) of the ACES film curve, as in the `tone` kernel."""
    curve = light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14)
    return np.minimum(curve, 1.0)


def _response(noise: float) -> tuple[Float32, Float32]:
    """Tabulate grey level and noise over the square root of the toned value.

    The variance of the sensor is shot noise, proportional to the light, plus read noise. The tone
    curve and gamma transfer it to the image, where it is strongest in dark tones.

    Args:
        noise: Standard deviation at middle grey, as a fraction of full scale.

    Returns:
        Grey levels, and standard deviations of the noise in grey levels, (_LUT_SIZE,) float32.
    """
    light = np.linspace(0, 4, 40_001) ** 2
    level = _filmic(light) ** (1 / _GAMMA)
    deviation = np.gradient(level, light + 1e-9) * np.sqrt(light + _READ_NOISE)
    deviation *= noise / np.interp(_MIDDLE_GREY, light, deviation)
    toned = np.linspace(0, 1, _LUT_SIZE) ** 2
    levels = toned ** (1 / _GAMMA)
    darkest = 2.0 * noise
    deviations = np.interp(levels, level, np.minimum(deviation, darkest))
    return (levels * 255 + 0.5).astype(np.float32), (deviations * 255).astype(np.float32)


def _blur(rng: np.random.Generator, settings: RgbSettings, toned: Float32) -> Float32:
    """Apply the lens blur, and in some frames motion blur in a random direction."""
    sigma = rng.uniform(*settings.blur_px)
    length, angle = rng.uniform(*settings.motion_px), rng.uniform(0, np.pi)
    moved = rng.random() < settings.motion_share
    if sigma > _LEAST_BLUR_PX:
        toned = np.asarray(cv2.GaussianBlur(toned, (0, 0), sigma), np.float32)
    if moved and length > _LEAST_BLUR_PX:
        toned = np.asarray(cv2.filter2D(toned, -1, _motion_kernel(length, angle)), np.float32)
    return toned


def _motion_kernel(length_px: float, angle_rad: float) -> Float32:
    """(K, K) weights of a straight motion of `length_px` through the centre."""
    half = int(np.ceil(length_px / 2)) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    along = np.linspace(-length_px / 2, length_px / 2, 8 * half + 1)
    x, y = half + along * np.cos(angle_rad), half + along * np.sin(angle_rad)
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    for right in (0, 1):
        for below in (0, 1):
            weight = np.abs(1 - right - (x - left)) * np.abs(1 - below - (y - top))
            np.add.at(kernel, (top + below, left + right), weight.astype(np.float32))
    return np.asarray(kernel / kernel.sum(), np.float32)


def expose(
    rng: np.random.Generator,
    settings: RgbSettings,
    samples: Float32,
    log_luminance: float,
    darkness: float = 0.0,
    error: float = 1.0,
    lens: Callable[[Float32], Float32] | None = None,
) -> UInt8:
    """Simulate the colour sensor.

    Args:
        rng: Source of random numbers.
        settings: Ranges of the sensor's parameters.
        samples: (2H, 2W, 3) float32 linear RGB.
        log_luminance: Mean log luminance of the samples, which the exposure is metered on.
        darkness: 0 (day) to 1 (dusk): the exposure decreases to `dusk_exposure`, and the noise
            increases to three times its value.
        error: Factor of the exposure.
        lens: Applied to the picture (H, W, 3) after the tone curve and before noise.

    Returns:
        (H, W, 3) uint8 BGR.
    """
    height, width = samples.shape[0] // 2, samples.shape[1] // 2
    exposure = rng.uniform(*settings.exposure) * (1 - (1 - settings.dusk_exposure) * darkness)
    gain = error * exposure * _MIDDLE_GREY / np.exp(log_luminance)
    red, blue = 1 + rng.uniform(*settings.white_balance, 2)
    noise = rng.uniform(*settings.noise) * (1 + (_DUSK_NOISE - 1) * darkness)

    off_x, off_y = (
        (_CORNER_LOSS * 2 * ((np.arange(n) + 0.5) / n - 0.5) ** 2).astype(np.float32)
        for n in (width, height)
    )
    toned = np.empty((height, width, 3), np.float32)
    tone(samples, (gain * np.array([red, 1, blue])).astype(np.float32), off_x, off_y, toned)
    toned = np.clip(_blur(rng, settings, toned), 0, 1)
    if lens is not None:
        toned = lens(toned)
    grain = rng.integers(0, 256, (height + 1, width + 1), np.uint8)
    colour_grain = rng.integers(0, 256, (height // 2 + 1, width // 2 + 1, 2), np.uint8)
    image = np.empty((height, width, 3), np.uint8)
    develop(toned, *_response(noise), _NORMALS, grain, colour_grain, image)
    return image
