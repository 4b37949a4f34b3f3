"""What the sensors make of a drawing: an 8-bit colour image and a measured depth map."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.render import Drawing
from perceptree.simulator.settings import SensorSettings

_MIDDLE_GREY = 0.22
_VIGNETTE = 0.5
_DEPTH_NOISE_CELL_PX = 4


def expose(
    rng: np.random.Generator, settings: SensorSettings, drawing: Drawing
) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 BGR: metered exposure, vignette, a filmic curve, gamma and sensor noise."""
    gain = rng.uniform(*settings.exposure) * _MIDDLE_GREY / np.exp(drawing.log_luminance)
    height, width = drawing.depth_m.shape
    rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
    off_axis = (columns / width - 0.5) ** 2 + (rows / height - 0.5) ** 2
    fall_off = np.repeat(np.repeat(1 - _VIGNETTE * off_axis, 2, 0), 2, 1)[..., None]
    x = drawing.samples * np.float32(gain) * fall_off
    x = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
    toned = cv2.resize(np.clip(x, 0, 1), (width, height), interpolation=cv2.INTER_AREA)
    image = toned ** np.float32(1 / 2.2)
    strength = np.float32(rng.uniform(*settings.noise))
    image += strength * rng.standard_normal(image.shape, np.float32) * (1.15 - image)
    bgr = np.clip(image[..., ::-1] * 255 + 0.5, 0, 255)
    return np.ascontiguousarray(bgr).astype(np.uint8)


def measure_depth(
    rng: np.random.Generator, settings: SensorSettings, depth_m: NDArray[np.float32]
) -> NDArray[np.float32]:
    """(H, W) float32 metres as a stereo camera gives it: smooth noise growing with z², a range."""
    height, width = depth_m.shape
    cell = _DEPTH_NOISE_CELL_PX
    coarse = rng.standard_normal((height // cell + 2, width // cell + 2), np.float32)
    grown = cv2.resize(coarse, None, fx=cell, fy=cell, interpolation=cv2.INTER_LINEAR)
    noise = grown[:height, :width] / np.float32(2 / 3)
    noisy = depth_m + np.float32(rng.uniform(*settings.depth_noise_per_m)) * depth_m**2 * noise
    seen = (depth_m > 0) & (noisy > 0) & (noisy < settings.depth_range_m)
    return np.where(seen, noisy, 0).astype(np.float32)
