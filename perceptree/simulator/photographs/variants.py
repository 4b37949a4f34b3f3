"""Texture layers from photographs: a new crop, colour and growth of moss in every scene."""

from __future__ import annotations

import cv2
import numpy as np

from basetree.arrays import Float, Float32, UInt8
from perceptree.simulator.materials.layers import SIZE_PX
from perceptree.simulator.materials.noise import smoothstep, spectral_noise
from perceptree.simulator.photographs.loading import Material, blend_seam

_MARGIN_PX = SIZE_PX // 8
_BARK_SCALE, _FLAT_SCALE = (0.55, 1.2), (0.6, 1.6)  # shown part of the longer side
_STEEPER = np.float32(1.4)  # photographed normals are flatter than the procedural ones
_MOST_SLOPE = np.float32(0.96)  # largest square of a normal's horizontal part
_KEPT = 0.5  # how much of a photograph's own brightness is kept, the rest is the layer's
_BRIGHTNESS, _HUE = 0.22, 0.06  # standard deviations of logarithms
_SATURATION = (0.6, 1.15)
_MOSS_SHARE = 0.3  # of the barks and stones
_MOSS = np.array([0.06, 0.085, 0.02], np.float32)
_LINEAR = ((np.arange(256) / 255) ** 2.2).astype(np.float32)
_GREY = np.array([0.3, 0.6, 0.1], np.float32)


def material_layer(
    rng: np.random.Generator, material: Material, mean: Float, upright: bool, mossy: bool
) -> tuple[Float32, Float32]:
    """Draw a layer from a material.

    Args:
        rng: Source of random numbers.
        material: The photograph.
        mean: (3,) mean linear RGB of the procedural layer.
        upright: Whether the picture's columns must stay vertical, as for bark.
        mossy: Whether moss may grow on it.

    Returns:
        (SIZE, SIZE, 3) linear RGB and (SIZE, SIZE, 3) normals, 0.5 being zero.
    """
    turns = 0 if upright else int(rng.integers(4))
    colour, slope = _turned(material.colour, material.slope, turns, bool(rng.random() < 0.5))
    low, high = _BARK_SCALE if upright else _FLAT_SCALE
    shown = float(np.exp(rng.uniform(np.log(low), np.log(high)))) * max(colour.shape[:2])
    first = rng.random(2) * colour.shape[:2]
    tones = _toned(rng, _LINEAR[_window(colour, first, shown)], mean)
    if mossy and rng.random() < _MOSS_SHARE:
        tones = _with_moss(rng, tones)
    normals = _normals(_window(slope, first, shown))
    return np.clip(tones, 0, 1), normals


def foliage_layer(rng: np.random.Generator, colour: UInt8, grey: bool, mean: Float) -> Float32:
    """Draw the colours (SIZE, SIZE, 3), linear RGB, of a cut-out layer.

    Plants grow upwards in photographs, and to the right in layers.

    Args:
        rng: Source of random numbers.
        colour: (H, W, 3) uint8 sRGB.
        grey: Whether to tint it with the colour of the layer.
        mean: (3,) mean linear RGB of the procedural layer.
    """
    laid = np.rot90(colour, -1)
    if rng.random() < 0.5:
        laid = laid[::-1]
    size = (SIZE_PX, SIZE_PX)
    tones = _LINEAR[cv2.resize(laid, size, interpolation=cv2.INTER_AREA)]
    if grey:
        tones = (tones @ _GREY)[..., None] * (mean / (mean @ _GREY)).astype(np.float32)
    return np.clip(_toned(rng, tones, mean), 0, 1)


def _turned(colour: UInt8, slope: UInt8, turns: int, mirrored: bool) -> tuple[UInt8, UInt8]:
    """Rotate by quarter turns to the left, and mirror; normals turn with the picture."""
    colour, slope = np.rot90(colour, turns), np.rot90(slope, turns)
    for _ in range(turns):
        slope = np.stack([255 - slope[..., 1], slope[..., 0]], -1)
    if mirrored:
        colour, slope = colour[:, ::-1], slope[:, ::-1]
        slope = np.stack([255 - slope[..., 0], slope[..., 1]], -1)
    return colour, slope


def _window(picture: UInt8, first: Float, shown_px: float) -> UInt8:
    """Show a square of a picture that wraps around as a layer that wraps around."""
    side = round(shown_px * (SIZE_PX + _MARGIN_PX) / SIZE_PX)
    rows = (int(first[0]) + np.arange(side)) % picture.shape[0]
    columns = (int(first[1]) + np.arange(side)) % picture.shape[1]
    size = (SIZE_PX + _MARGIN_PX, SIZE_PX + _MARGIN_PX)
    way = cv2.INTER_AREA if side > size[0] else cv2.INTER_LINEAR
    scaled = cv2.resize(np.ascontiguousarray(picture[rows][:, columns]), size, interpolation=way)
    return np.asarray(blend_seam(blend_seam(scaled, 0, _MARGIN_PX), 1, _MARGIN_PX), np.uint8)


def _normals(slope: UInt8) -> Float32:
    """(H, W, 3) unit normals, 0.5 being zero, of slopes (H, W, 2) as in Material."""
    steep = (slope.astype(np.float32) / np.float32(127.5) - 1) * _STEEPER
    x, y = steep[..., 0], steep[..., 1]
    flat = x * x + y * y
    most = np.sqrt(np.minimum(1, _MOST_SLOPE / np.maximum(flat, np.float32(1e-6))))
    x, y = x * most, y * most
    normal = np.stack([x, y, np.sqrt(1 - x * x - y * y)], -1)
    return np.asarray(normal * np.float32(0.5) + np.float32(0.5), np.float32)


def _toned(rng: np.random.Generator, tones: Float32, mean: Float) -> Float32:
    """Vary saturation and hue, and bring the brightness halfway to that of the layer."""
    grey = (tones @ _GREY)[..., None]
    pale = grey + (tones - grey) * np.float32(rng.uniform(*_SATURATION))
    own, usual = max(float(grey.mean()), 1e-3), max(float(mean @ _GREY), 1e-3)
    gain = (usual / own) ** (1 - _KEPT) * np.exp(rng.normal(0, _BRIGHTNESS))
    return np.asarray(pale * (gain * np.exp(rng.normal(0, _HUE, 3))).astype(np.float32))


def _with_moss(rng: np.random.Generator, tones: Float32) -> Float32:
    least = float(rng.uniform(-0.4, 1.2))
    patch = smoothstep(least, least + 0.8, spectral_noise(rng, tones.shape[:2], 2.2))[..., None]
    grey = (tones @ _GREY)[..., None]
    moss = _MOSS * (np.float32(0.5) + np.float32(0.5) * grey / max(float(grey.mean()), 1e-3))
    return np.asarray(tones + (moss - tones) * patch * np.float32(0.85))
