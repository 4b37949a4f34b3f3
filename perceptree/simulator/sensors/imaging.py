"""Faults of real cameras: lens errors, dirt and drops on the lens, and image processing.

No fault moves picture content by more than half a pixel, so labels remain valid. The probability
and size of the faults were chosen by eye.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from basetree.arrays import Float, Float32, UInt8
from perceptree.simulator.settings import ImagingSettings

_Fault = Callable[[np.random.Generator, float, Any], Any]

_LENS_CHANCE = 0.35
_CHANCE = 0.4
_FRINGE_PX = 0.5


@dataclass(frozen=True)
class CameraFaults:
    """Camera faults of a frame.

    Attributes:
        saturation: Factor of the colour saturation.
        strength: Strength of the other faults, 0 (none) to 1 (worst).
        exposure_stops: Exposure error in stops.
        infrared: Whether the picture is a grey near-infrared one.
    """

    saturation: float
    strength: float
    exposure_stops: float
    infrared: bool


def draw_faults(rng: np.random.Generator, settings: ImagingSettings) -> CameraFaults:
    """Draw the camera faults of one frame."""
    faulty, strength = rng.random() < settings.share, float(rng.uniform(*settings.strength))
    stops, infrared = float(rng.uniform(*settings.exposure_stops)), rng.random()
    saturation = float(rng.uniform(*settings.saturation))
    if not faulty:
        return CameraFaults(saturation, 0.0, 0.0, False)
    return CameraFaults(saturation, strength, stops, bool(infrared < settings.infrared_share))


def apply_lens_faults(rng: np.random.Generator, strength: float, toned: Float32) -> Float32:
    """Apply random lens faults, before the sensor's noise.

    Args:
        rng: Source of random numbers.
        strength: Strength of the faults, 0 to 1.
        toned: (H, W, 3) float32 BGR after the tone curve, 0 to 1.

    Returns:
        (H, W, 3) float32 BGR, 0 to 1.
    """
    for fault in (_bloom, _veil, _defocus, _fringes, _drops, _dirt):
        if rng.random() < _LENS_CHANCE:
            toned = fault(rng, strength, toned)
    return np.clip(toned, 0, 1)


def apply_processing_faults(rng: np.random.Generator, faults: CameraFaults, image: UInt8) -> UInt8:
    """Apply saturation or near-infrared, and random faults of the camera's image processing.

    Args:
        rng: Source of random numbers.
        faults: The faults of the frame.
        image: (H, W, 3) uint8 BGR.

    Returns:
        (H, W, 3) uint8 BGR; `image` itself if there is nothing to change.
    """
    if faults.infrared:
        image = infrared(image)
    elif faults.saturation != 1:
        image = saturated(image, faults.saturation)
    if not faults.strength:
        return image
    for fault in _TONE_FAULTS if faults.infrared else (*_COLOUR_FAULTS, *_TONE_FAULTS):
        if rng.random() < _CHANCE:
            image = fault(rng, faults.strength, image)
    return image


def saturated(image: UInt8, factor: float) -> UInt8:
    """Scale the distance of colours from grey by `factor`: (H, W, 3) uint8."""
    grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    return np.asarray(cv2.addWeighted(image, factor, grey, 1 - factor, 0), np.uint8)


def infrared(image: UInt8) -> UInt8:
    """Imitate a near-infrared picture: grey with bright leaves, (H, W, 3) uint8."""
    blue, green, red = (image[..., channel].astype(np.float32) for channel in range(3))
    leaf = np.maximum(green - 0.5 * (red + blue), 0)
    grey = 0.3 * blue + 0.35 * green + 0.35 * red + 2.0 * leaf
    return np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, 2)


def _blurred(picture: Float32, sigma_px: float) -> Float32:
    """A wide Gaussian blur, computed at reduced resolution for speed."""
    height, width = picture.shape[:2]
    factor = max(1, int(sigma_px / 2))
    small = cv2.resize(picture, (width // factor, height // factor), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma_px / factor)
    return np.asarray(cv2.resize(small, (width, height)), np.float32)


def _bloom(rng: np.random.Generator, strength: float, toned: Float32) -> Float32:
    """Blooming: light of overexposed areas spreads to their surroundings."""
    bright = np.maximum(toned - 0.82, 0) * np.float32(4 * rng.uniform(0.3, 1.0) * strength)
    return toned + _blurred(bright, rng.uniform(2, 0.03 * toned.shape[1]))


def _veil(rng: np.random.Generator, strength: float, toned: Float32) -> Float32:
    """Veiling glare: stray light moves the whole picture towards its mean colour."""
    share = np.float32(0.35 * strength * rng.random())
    return np.asarray(toned * (1 - share) + share * toned.mean((0, 1)), np.float32)


def _defocus(rng: np.random.Generator, strength: float, toned: Float32) -> Float32:
    """Defocus: blur by a round circle of confusion."""
    radius = 1 + int(rng.uniform(0.3, 1.0) * strength * toned.shape[1] / 400)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return np.asarray(cv2.filter2D(toned, -1, kernel / np.float32(kernel.sum())), np.float32)


def _fringes(rng: np.random.Generator, strength: float, toned: Float32) -> Float32:
    """Lateral chromatic aberration: red and blue have another scale than green."""
    height, width = toned.shape[:2]
    result = toned.copy()
    for channel, sign in ((0, 1.0), (2, -1.0)):
        scale = 1 + sign * strength * rng.uniform(-1, 1) * _FRINGE_PX / (0.5 * width)
        centre_x, centre_y = (width - 1) / 2, (height - 1) / 2
        matrix = np.array([[scale, 0, centre_x * (1 - scale)], [0, scale, centre_y * (1 - scale)]])
        result[..., channel] = cv2.warpAffine(
            toned[..., channel], matrix, (width, height), borderMode=cv2.BORDER_REPLICATE
        )
    return result


def _spots(rng: np.random.Generator, count: int, shape: tuple[int, ...], size: float) -> Float32:
    """(H, W, 1) opacity of soft round spots with radii up to `size` times the image width."""
    height, width = shape[:2]
    cover = np.zeros((height, width), np.float32)
    for _ in range(count):
        centre = int(rng.integers(width)), int(rng.integers(height))
        axes = rng.uniform(0.2, 1.0) * size * width * np.array([1.0, rng.uniform(0.7, 1.3)])
        lengths = (int(axes[0]) + 1, int(axes[1]) + 1)
        cv2.ellipse(cover, centre, lengths, rng.uniform(0, 180), 0, 360, rng.uniform(0.4, 1.0), -1)
    soft = cv2.GaussianBlur(cover, (0, 0), max(0.8, 0.15 * size * width))
    return np.asarray(soft[..., None], np.float32)


def _drops(rng: np.random.Generator, strength: float, toned: Float32) -> Float32:
    """Water drops on the lens blur what is behind them."""
    cover = _spots(rng, 1 + int(14 * strength * rng.random()), toned.shape, 0.025)
    return toned + (_blurred(toned, 0.02 * toned.shape[1]) * np.float32(1.1) - toned) * cover


def _dirt(rng: np.random.Generator, strength: float, toned: Float32) -> Float32:
    """Mud on the lens, out of focus: soft brown spots."""
    cover = _spots(rng, 1 + int(5 * strength * rng.random()), toned.shape, 0.05)
    soft = _blurred(cover, 0.02 * toned.shape[1])[..., None]
    return toned + (np.array([0.05, 0.08, 0.11], np.float32) - toned) * (0.7 * soft)


def _white_balance(rng: np.random.Generator, strength: float, image: UInt8) -> UInt8:
    """Wrong white balance, mostly too warm or too cold."""
    warm, green = rng.normal(0, 0.14 * strength), rng.normal(0, 0.05 * strength)
    gains = np.exp([-warm, green, warm])
    return _mapped(image, [np.arange(256) * gain for gain in gains / gains.mean()])


def _curve(rng: np.random.Generator, strength: float, image: UInt8) -> UInt8:
    """Another tone curve: changed contrast and brightness, clipped shadows or highlights."""
    low = rng.uniform(-0.1, 0.18) * strength
    high = 1 - rng.uniform(-0.1, 0.25) * strength
    gamma = np.exp(rng.normal(0, 0.35 * strength))
    tone = np.clip((np.arange(256) / 255 - low) / (high - low), 0, 1) ** gamma
    return _mapped(image, [255 * tone] * 3)


def _mapped(image: UInt8, tables: Sequence[Float]) -> UInt8:
    table = np.clip(np.stack(tables, -1), 0, 255).astype(np.uint8)[None]
    return np.asarray(cv2.LUT(image, table), np.uint8)


def _saturation(rng: np.random.Generator, strength: float, image: UInt8) -> UInt8:
    """Too weak or too strong colours."""
    return saturated(image, float(np.exp(rng.normal(0, 0.45 * strength))))


def _chroma_noise(rng: np.random.Generator, strength: float, image: UInt8) -> UInt8:
    """Colour noise in blotches several pixels wide."""
    height, width = image.shape[:2]
    side = int(rng.integers(2, 7))
    noise = rng.normal(0, 12 * strength, (height // side + 1, width // side + 1, 3))
    noise -= noise.mean(-1, keepdims=True)
    grown = cv2.resize(noise.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(image + grown, 0, 255), np.uint8)


def _smear(rng: np.random.Generator, strength: float, image: UInt8) -> UInt8:
    """Noise reduction that removes fine texture."""
    return np.asarray(cv2.bilateralFilter(image, 5, 10 + 50 * strength * rng.random(), 3), np.uint8)


def _low_resolution(rng: np.random.Generator, strength: float, image: UInt8) -> UInt8:
    """Reduced resolution, enlarged again to the picture's size."""
    height, width = image.shape[:2]
    share = 1 - rng.uniform(0.1, 0.65) * strength
    size = max(64, round(width * share)), max(64, round(height * share))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    way = cv2.INTER_LINEAR if rng.random() < 0.5 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(small, (width, height), interpolation=way), np.uint8)


def _sharpen(rng: np.random.Generator, strength: float, image: UInt8) -> UInt8:
    """Unsharp masking, which gives light and dark halos along edges."""
    amount, sigma = 2.2 * strength * rng.random(), rng.uniform(0.7, 2.2)
    soft = cv2.GaussianBlur(image, (0, 0), sigma)
    return np.asarray(cv2.addWeighted(image, 1 + amount, soft, -amount, 0), np.uint8)


def _banner(rng: np.random.Generator, strength: float, image: UInt8) -> UInt8:
    """The banner with date and temperature that a game camera prints on the picture's edge."""
    if rng.random() > 0.3:
        return image
    marked, height = image.copy(), image.shape[0]
    thick = max(8, int(0.03 * height))
    top = 0 if rng.random() < 0.5 else height - thick
    marked[top : top + thick] = 0 if rng.random() < 0.7 else 230
    ink = (255, 255, 255) if not marked[top, 0].any() else (0, 0, 0)
    text = " ".join(str(number) for number in rng.integers(0, 3000, 6))
    scale = thick / 30
    cv2.putText(marked, text, (4, top + int(0.8 * thick)), cv2.FONT_HERSHEY_PLAIN, scale, ink)
    return marked


def _jpeg(rng: np.random.Generator, strength: float, image: UInt8) -> UInt8:
    """Artefacts of strong JPEG compression."""
    quality = int(90 - 70 * strength * rng.random())
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


_COLOUR_FAULTS: Sequence[_Fault] = (_white_balance, _saturation, _chroma_noise)
_TONE_FAULTS: Sequence[_Fault] = (_curve, _smear, _low_resolution, _sharpen, _banner, _jpeg)
