"""Colour augmentation: light, colour, tone, sharpness, dirt, noise, compression."""

from __future__ import annotations

import math

import cv2
import numpy as np

from basetree.arrays import Float, UInt8
from perceptree.data.augment.randomness import (
    add_levels,
    is_drawn,
    normal_levels,
    smooth_field,
    uniform_symmetric,
    uniform_up_to,
)
from perceptree.settings.augmentation import ColourSettings

_LIGHT_CELL_PX = 8
_LIGHT_ONE = 100
_CONTRAST_CENTRE = 0.4
_CURVE_KNOTS = 6
_CHROMA_CELL_PX = 4
_MAX_CUTOUT_SHARE = 0.1
# NTSC's YIQ colour space, from blue, green, red.
_TO_YIQ = np.array([[0.114, 0.587, 0.299], [-0.3213, -0.2746, 0.5959], [0.3106, -0.5227, 0.2115]])
_FROM_YIQ = np.linalg.inv(_TO_YIQ)


def recolour(rng: np.random.Generator, image: UInt8, settings: ColourSettings) -> UInt8:
    """Apply all colour changes, in the order of the settings.

    Args:
        rng: Source of the random numbers.
        image: (H, W, 3) BGR uint8.
        settings: Strengths of the changes.

    Returns:
        (H, W, 3) BGR uint8.
    """
    image = _vary_light(rng, image, settings)
    toned = is_drawn(rng, settings.tone_share)
    image = _mix_channels(rng, image, settings, settings.tint if toned else 0.0)
    if toned:
        image = _tone(rng, image, settings)
    if is_drawn(rng, settings.blur_share):
        image = _vary_sharpness(rng, image, settings)
    if settings.cutouts:
        image = _add_cutouts(rng, image, settings.cutouts)
    if is_drawn(rng, settings.noise_share):
        image = _add_noise(rng, image, settings)
    if is_drawn(rng, settings.jpeg_share):
        quality = round(float(rng.uniform(*settings.jpeg_quality)))
        _, packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
        image = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)
    return image


def _vary_light(rng: np.random.Generator, image: UInt8, settings: ColourSettings) -> UInt8:
    """Multiply all channels by one smooth gain: shadows, and darker corners (vignetting)."""
    if not settings.shadow and not settings.vignette:
        return image
    height, width = image.shape[:2]
    rows, columns = (max(2, side // _LIGHT_CELL_PX) for side in (height, width))
    hardness = float(rng.uniform(0.5, 4))
    field = smooth_field(rng, rows, columns, float(rng.uniform(0.15, 0.6)) * rows)
    log_gain = uniform_up_to(rng, settings.shadow) * np.tanh(hardness * field)
    y, x = np.mgrid[-1 : 1 : rows * 1j, -1 : 1 : columns * 1j]
    corner = 1 - uniform_up_to(rng, settings.vignette) * (x**2 + y**2) / 2
    gain = np.clip(np.exp(log_gain) * corner * _LIGHT_ONE, 0, 255).astype(np.uint8)
    gain = cv2.resize(gain, (width, height))
    lit = cv2.multiply(image, cv2.merge([gain] * 3), scale=1 / _LIGHT_ONE)
    return np.asarray(lit, np.uint8)


def _mix_channels(
    rng: np.random.Generator, image: UInt8, settings: ColourSettings, tint: float
) -> UInt8:
    """Change saturation, hue, channel order and tint by one 3x3 matrix."""
    keep = 1.0
    if settings.saturation and is_drawn(rng, settings.saturation_share):
        keep += float(rng.uniform(-settings.saturation, 0.5 * settings.saturation))
    angle = math.radians(uniform_symmetric(rng, settings.hue_deg))
    if is_drawn(rng, settings.grey_share):
        keep = 0.0
    order = [0, 1, 2]
    if is_drawn(rng, settings.channel_shuffle_share):
        order = rng.permutation(3).tolist()
    if keep == 1.0 and not angle and not tint and order == [0, 1, 2]:
        return image
    chroma = np.eye(3)
    chroma[1:, 1:] = keep * np.array(
        [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    )
    matrix = (_FROM_YIQ @ chroma @ _TO_YIQ)[order]
    if tint:
        matrix *= np.exp(rng.uniform(-tint, tint, (3, 1)))
    return np.asarray(cv2.transform(image, matrix), np.uint8)


def _tone(rng: np.random.Generator, image: UInt8, settings: ColourSettings) -> UInt8:
    """Apply tone curves, gamma, gain and contrast by one lookup table."""
    if not any((settings.brightness, settings.contrast, settings.gamma, settings.curves)):
        return image
    level: Float = np.linspace(0, 1, 256)[:, None]
    if settings.curves:
        level = _curves(rng, uniform_up_to(rng, settings.curves))
    gain = math.exp(uniform_symmetric(rng, settings.brightness))
    contrast = math.exp(uniform_symmetric(rng, settings.contrast))
    gamma = math.exp(uniform_symmetric(rng, settings.gamma))
    table = level**gamma * gain
    table = (table - _CONTRAST_CENTRE) * contrast + _CONTRAST_CENTRE
    table8 = np.rint(np.clip(table * 255, 0, 255)).astype(np.uint8)
    return np.asarray(cv2.LUT(image, table8[None]), np.uint8)


def _curves(rng: np.random.Generator, deviation: float) -> Float:
    """Return (256, 3) levels of random increasing curves from 0 to 1."""
    positions = np.linspace(0, _CURVE_KNOTS - 1, 256)
    knots = rng.standard_normal((3, _CURVE_KNOTS)) * deviation
    slopes = np.exp([np.interp(positions, np.arange(_CURVE_KNOTS), row) for row in knots])
    slopes[:, 0] = 0
    return np.asarray((slopes.cumsum(1) / slopes.sum(1, keepdims=True)).T)


def _vary_sharpness(rng: np.random.Generator, image: UInt8, settings: ColourSettings) -> UInt8:
    """Apply one of the enabled changes: blur, motion blur or sharpening."""
    methods = (("blur_px", _blur), ("motion_blur_px", _motion_blur), ("sharpening", _sharpen))
    choices = [
        (method, getattr(settings, name)) for name, method in methods if getattr(settings, name)
    ]
    if not choices:
        return image
    method, maximum = choices[int(rng.integers(len(choices)))]
    return method(rng, image, uniform_up_to(rng, maximum))


def _blur(rng: np.random.Generator, image: UInt8, deviation_px: float) -> UInt8:
    if deviation_px < 0.2:
        return image
    size = 2 * math.ceil(3 * deviation_px) + 1
    return np.asarray(cv2.GaussianBlur(image, (size, size), deviation_px), np.uint8)


def _motion_blur(rng: np.random.Generator, image: UInt8, length_px: float) -> UInt8:
    reach = math.ceil(length_px / 2)
    angle = float(rng.uniform(0, math.pi))
    step = np.array([math.cos(angle), math.sin(angle)]) * length_px / 2
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.uint8)
    # shift=4: coordinates in sixteenths of a pixel.
    start, end = (np.rint((reach + side * step) * 16).astype(int).tolist() for side in (-1, 1))
    cv2.line(kernel, start, end, 255, 1, cv2.LINE_AA, shift=4)
    weights = kernel.astype(np.float32) / max(1.0, float(kernel.sum()))
    return np.asarray(cv2.filter2D(image, -1, weights), np.uint8)


def _sharpen(rng: np.random.Generator, image: UInt8, gain: float) -> UInt8:
    blurred = cv2.GaussianBlur(image, (5, 5), 1.0)
    return np.asarray(cv2.addWeighted(image, 1 + gain, blurred, -gain, 0), np.uint8)


def _add_cutouts(rng: np.random.Generator, image: UInt8, maximum: int) -> UInt8:
    covered = image.copy()
    height, width = image.shape[:2]
    for _ in range(int(rng.integers(maximum + 1))):
        w, h = rng.integers(1, max(2, round(height * _MAX_CUTOUT_SHARE)) + 1, 2)
        x, y = rng.integers(1 - w, width), rng.integers(1 - h, height)
        covered[max(0, y) : y + h, max(0, x) : x + w] = rng.integers(0, 256, 3)
    return covered


def _add_noise(rng: np.random.Generator, image: UInt8, settings: ColourSettings) -> UInt8:
    deviation = uniform_up_to(rng, settings.noise)
    if deviation:
        image = add_levels(image, normal_levels(rng, image.shape, deviation))
    deviation = uniform_up_to(rng, settings.chroma_noise)
    if deviation:
        height, width = image.shape[:2]
        coarse = (-(-height // _CHROMA_CELL_PX), -(-width // _CHROMA_CELL_PX), 3)
        patches = cv2.resize(normal_levels(rng, coarse, deviation), (width, height))
        image = add_levels(image, np.asarray(patches, np.uint8))
    return image
