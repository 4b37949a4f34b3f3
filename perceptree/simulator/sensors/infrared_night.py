"""How camera traps take pictures with an infrared lamp at night."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from basetree.arrays import Float32, Float64, UInt8
from perceptree.simulator.settings import TrapSettings

_REFLECTANCE = 0.3  # of the surface that the reach is stated for
_METERED = 0.5  # part of the exposure, in stops, that follows the picture's mean
_BEAM_SHIFT = 0.15  # standard deviation of the beam's middle, as a fraction of the width
_BANDS = 0.06  # standard deviation of columns' brightness, over that of the grain
_TINTS = ((1.10, 0.90, 1.06), (0.94, 1.06, 0.96), (1.12, 0.96, 0.98))  # BGR: purple, green, blue
_MEAN_STRIDE = 4


@dataclass(frozen=True)
class InfraredNight:
    """An infrared camera trap at one frame, with the values of TrapSettings.

    Attributes:
        reach_m: Distance at which a surface is middle grey, m.
        beam: Width of the lamp's beam, as a fraction of the picture's width.
        beam_shift: (2,) shift of its middle, as a fraction of the picture's width.
        blur_px: Standard deviation of the blur, px.
        grain: Standard deviation of the grain, as a fraction of full scale.
        grain_px: Size of the grain, px.
        floor: Brightness of black, as a fraction of full scale.
        tint: (3,) BGR factors.
    """

    reach_m: float
    beam: float
    beam_shift: Float64
    blur_px: float
    grain: float
    grain_px: float
    floor: float
    tint: tuple[float, float, float]


def draw_night(rng: np.random.Generator, settings: TrapSettings) -> InfraredNight:
    """Draw the camera of one frame."""
    tinted, tint = rng.random() < settings.tint_share, _TINTS[rng.integers(len(_TINTS))]
    return InfraredNight(
        float(np.exp(rng.uniform(*np.log(settings.reach_m)))),
        float(rng.uniform(*settings.beam)),
        rng.normal(0, _BEAM_SHIFT, 2),
        float(rng.uniform(*settings.blur_px)),
        float(rng.uniform(*settings.grain)),
        float(rng.uniform(0.0, 1.0)),
        float(rng.uniform(*settings.floor)),
        tint if tinted else (1.0, 1.0, 1.0),
    )


def light_beam(night: InfraredNight, samples: Float32) -> Float32:
    """Darken (H, W, 3) linear samples off the middle of the lamp's beam."""
    height, width = samples.shape[:2]
    x = (np.arange(width) + 0.5) / width - 0.5 - night.beam_shift[0]
    y = (np.arange(height) + 0.5 - height / 2) / width - night.beam_shift[1]
    across, down = (np.exp(-0.5 * (place / night.beam) ** 2).astype(np.float32) for place in (x, y))
    return np.asarray(samples * (down[:, None] * across)[..., None], np.float32)


def metered_luminance(night: InfraredNight, samples: Float32) -> float:
    """Logarithm of the luminance that the camera makes middle grey, with a lamp of strength 1."""
    mean = float(samples[::_MEAN_STRIDE, ::_MEAN_STRIDE, 1].mean(dtype=np.float64))
    fixed = _REFLECTANCE / night.reach_m**2
    return float(_METERED * np.log(max(mean, 1e-6)) + (1 - _METERED) * np.log(fixed))


def night_picture(rng: np.random.Generator, night: InfraredNight, image: UInt8) -> UInt8:
    """Make a picture grey, soft and grainy, with a floor and a tint.

    Args:
        rng: Source of random numbers.
        night: The camera.
        image: (H, W, 3) uint8 BGR.

    Returns:
        (H, W, 3) uint8 BGR.
    """
    grey = image[..., 1].astype(np.float32)
    if night.blur_px > 0:
        grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), night.blur_px), np.float32)
    grey += 255 * night.grain * _grain(rng, grey.shape, night.grain_px)
    bands = np.float32(255 * night.grain * _BANDS) * rng.standard_normal(grey.shape[1], np.float32)
    grey = np.maximum(grey + bands, 0)
    grey = 255 * night.floor + (1 - night.floor) * grey
    tinted = grey[..., None] * np.array(night.tint, np.float32)
    return np.asarray(np.clip(tinted + 0.5, 0, 255), np.uint8)


def _grain(rng: np.random.Generator, shape: tuple[int, ...], size_px: float) -> Float32:
    """Noise (H, W) of standard deviation 1 that is correlated over `size_px`."""
    noise = rng.standard_normal(shape, np.float32)
    if size_px < 0.3:
        return noise
    soft = cv2.GaussianBlur(noise, (0, 0), size_px)
    return np.asarray(soft / soft.std(), np.float32)
