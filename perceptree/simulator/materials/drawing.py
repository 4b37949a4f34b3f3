"""Helper functions to draw textures: colours, noise fields and strokes."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from basetree.arrays import Float, Float32
from perceptree.simulator.materials.layers import SIZE_PX
from perceptree.simulator.materials.noise import spectral_noise

DrawFunction = Callable[[np.random.Generator, Float32], None]


def rgb(red: int, green: int, blue: int) -> Float:
    """Convert 8-bit sRGB to (3,) numbers from 0 to 1."""
    return np.array([red, green, blue], np.float32) / 255


def mix(first: Float, second: Float, share: Float) -> Float:
    """Blend colours: `first` where `share` (H, W) is 0, `second` where it is 1."""
    return np.asarray(first + (second - first) * share[..., None])


def noise(rng: np.random.Generator, exponent: float, *stretch: float) -> Float:
    """Periodic noise (SIZE, SIZE) with zero mean and unit deviation, as `spectral_noise`."""
    rows, columns = stretch or (1.0, 1.0)
    return spectral_noise(rng, (SIZE_PX, SIZE_PX), exponent, (rows, columns))


def cutout(rng: np.random.Generator, draw: DrawFunction, background: tuple[int, int, int]) -> Float:
    """Draw a cut-out texture at twice its size, and reduce it.

    Args:
        rng: Source of random numbers.
        draw: Draws on a canvas (2 SIZE, 2 SIZE, 4) of colour and alpha.
        background: 8-bit colour of transparent pixels, which tints the soft edges.

    Returns:
        (SIZE, SIZE, 4) colour and alpha, 0 to 1.
    """
    canvas = np.zeros((2 * SIZE_PX, 2 * SIZE_PX, 4), np.float32)
    draw(rng, canvas)
    small = cv2.resize(canvas, (SIZE_PX, SIZE_PX), interpolation=cv2.INTER_AREA)
    alpha = small[..., 3:]
    colour = np.where(alpha > 0.02, small[..., :3] / np.maximum(alpha, 1e-3), rgb(*background))
    return np.concatenate([colour, alpha], -1)


def ink(base: tuple[int, int, int], strength: float) -> tuple[float, float, float, float]:
    """An opaque colour for OpenCV's drawing functions, times `strength`."""
    red, green, blue = (channel * strength / 255 for channel in base)
    return red, green, blue, 1.0


def point(x: float, y: float) -> tuple[int, int]:
    """Round a point to whole pixels, for OpenCV's drawing functions."""
    return round(x), round(y)
