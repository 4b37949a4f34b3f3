"""Materials: procedural albedo, alpha and normal textures, one square layer each."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.noise import smoothstep, spectral_noise, worley_cells

Float = NDArray[np.floating[Any]]

SIZE_PX = 512
MIP_LEVELS = 8


class Layer(enum.IntEnum):
    """Texture layers; those from ``FIR_TWIG`` to ``FERN`` are cut out by their alpha."""

    FIR_BARK = 0
    BEECH_BARK = 1
    LITTER = 2
    MOSS = 3
    FIR_TWIG = 4
    LEAVES = 5
    GRASS = 6
    FERN = 7
    DEAD_WOOD = 8
    CUT_WOOD = 9


@dataclass(frozen=True)
class Textures:
    """All layers and their mip levels in flat arrays.

    ``albedo`` (N, 4) uint8: square root of linear RGB, and alpha; ``normals`` (N, 3) uint8;
    ``offsets`` (levels,): where a level starts. In a level the layers follow each other.
    """

    albedo: NDArray[np.uint8]
    alpha: NDArray[np.uint8]
    normals: NDArray[np.uint8]
    offsets: NDArray[np.int64]


def _rgb(red: int, green: int, blue: int) -> Float:
    return np.array([red, green, blue], np.float32) / 255


def _mix(first: Float, second: Float, share: Float) -> Float:
    return np.asarray(first + (second - first) * share[..., None])


def _noise(rng: np.random.Generator, exponent: float, *stretch: float) -> Float:
    return spectral_noise(rng, (SIZE_PX, SIZE_PX), exponent, stretch or (1.0, 1.0))  # type: ignore[arg-type]


def _fir_bark(rng: np.random.Generator) -> tuple[Float, Float]:
    edge, cell = worley_cells(rng, SIZE_PX, 330, 0.62, _noise(rng, 2.4))
    fine, broad = _noise(rng, 1.0), _noise(rng, 2.2)
    plate = smoothstep(0.0, 0.022, edge)
    tone = rng.random(330)[cell]
    colour = _mix(
        _rgb(84, 73, 65), _rgb(146, 131, 117), np.clip(0.45 * tone + 0.28 + 0.11 * fine, 0, 1)
    )
    colour = _mix(colour, _rgb(44, 35, 30), (1 - plate) * 0.8)
    colour = _mix(colour, _rgb(108, 76, 56), smoothstep(0.4, 1.5, _noise(rng, 1.7)) * 0.45)
    colour = _mix(colour, _rgb(150, 158, 140), smoothstep(0.9, 1.6, _noise(rng, 1.9)) * 0.65)
    return colour * (1 + 0.09 * fine[..., None]), 0.9 * plate + 0.35 * tone + 0.2 * fine + (
        0.12 * broad
    )


def _beech_bark(rng: np.random.Generator) -> tuple[Float, Float]:
    broad, scars = _noise(rng, 2.3, 1.4, 0.6), _noise(rng, 1.1, 2.2, 0.6)
    colour = _mix(_rgb(92, 89, 82), _rgb(138, 134, 125), smoothstep(-1.4, 1.4, broad))
    colour = _mix(colour, _rgb(176, 178, 168), smoothstep(0.8, 1.3, _noise(rng, 1.8)) * 0.6)
    colour = _mix(colour, _rgb(56, 52, 46), smoothstep(1.1, 1.9, scars) * 0.65)
    colour = _mix(colour, _rgb(84, 100, 60), smoothstep(0.8, 1.8, _noise(rng, 2.4)) * 0.5)
    return colour * (1 + 0.05 * scars[..., None]), 0.35 * broad + 0.25 * scars


def _strokes(rng: np.random.Generator, image: Float, height: Float, count: int) -> None:
    """Needles, twigs and fallen leaves drawn on the litter, wrapping at its borders."""
    palette = np.array([[132, 98, 60], [104, 68, 42], [152, 124, 86], [66, 50, 38], [88, 84, 60]])
    for index in range(count):
        start = rng.uniform(0, SIZE_PX, 2)
        angle, length = rng.uniform(0, 2 * np.pi), rng.uniform(3, 13)
        colour = (palette[rng.integers(5)] * rng.uniform(0.45, 1.2) / 255).tolist()
        along = np.array([np.cos(angle), np.sin(angle)]) * length
        across = np.array([-along[1], along[0]]) * 0.32
        level = 0.47 + 0.53 * index / count
        for shift in ((0, 0), (-SIZE_PX, 0), (0, -SIZE_PX), (-SIZE_PX, -SIZE_PX)):
            origin = start + shift
            if index % 9 == 0:
                outline = [origin, origin + 0.5 * along + across, origin + along]
                polygon = np.array([*outline, origin + 0.5 * along - across], np.int32)
                cv2.fillPoly(image, [polygon], colour)
                cv2.fillPoly(height, [polygon], level)
            else:
                ends = np.array([origin, origin + along], np.int32)
                cv2.line(image, ends[0].tolist(), ends[1].tolist(), colour, 1 + index % 2)
                cv2.line(height, ends[0].tolist(), ends[1].tolist(), level, 1 + index % 2)


def _litter(rng: np.random.Generator) -> tuple[Float, Float]:
    broad = _noise(rng, 2.0)
    base = _mix(_rgb(44, 33, 24), _rgb(86, 66, 46), smoothstep(-1.3, 1.3, _noise(rng, 0.9)))
    image = np.ascontiguousarray(base, np.float32)
    height = np.zeros((SIZE_PX, SIZE_PX), np.float32)
    _strokes(rng, image, height, 5200)
    return image * (1 + 0.12 * broad[..., None]), height * 2.8 + 0.4 * broad


def _moss(rng: np.random.Generator) -> tuple[Float, Float]:
    fine, broad = _noise(rng, 0.8), _noise(rng, 1.8)
    shade = smoothstep(-1.5, 1.7, np.asarray(fine * 0.6 + broad * 0.6))
    colour = _mix(_rgb(36, 46, 18), _rgb(92, 108, 38), shade)
    colour = _mix(colour, _rgb(112, 104, 50), smoothstep(0.4, 1.6, _noise(rng, 2.2)) * 0.5)
    return colour, 0.8 * broad + 0.5 * fine


def _cut_wood(rng: np.random.Generator) -> tuple[Float, Float]:
    rows, columns = np.mgrid[0:SIZE_PX, 0:SIZE_PX] / SIZE_PX - 0.5
    rings = np.sin(np.hypot(rows, columns) * 190 + 2.5 * _noise(rng, 2.6))
    tone = smoothstep(-1.6, 1.6, np.asarray(0.5 * rings + 0.8 * _noise(rng, 1.6)))
    return _mix(_rgb(96, 74, 50), _rgb(158, 132, 96), tone), 0.1 * rings


_Draw = Callable[[np.random.Generator, NDArray[np.float32]], None]


def _cutout(rng: np.random.Generator, draw: _Draw, background: tuple[int, int, int]) -> Float:
    """(SIZE, SIZE, 4) foliage drawn at twice the size; ``background`` tints the soft edges."""
    canvas = np.zeros((2 * SIZE_PX, 2 * SIZE_PX, 4), np.float32)
    draw(rng, canvas)
    small = cv2.resize(canvas, (SIZE_PX, SIZE_PX), interpolation=cv2.INTER_AREA)
    alpha = small[..., 3:]
    colour = np.where(alpha > 0.02, small[..., :3] / np.maximum(alpha, 1e-3), _rgb(*background))
    return np.concatenate([colour, alpha], -1)


def _ink(base: tuple[int, int, int], strength: float) -> tuple[float, float, float, float]:
    red, green, blue = (channel * strength / 255 for channel in base)
    return red, green, blue, 1.0


def _point(x: float, y: float) -> tuple[int, int]:
    return round(x), round(y)


def _needles(rng: np.random.Generator, canvas: Float, start: Float, end: Float, count: int) -> None:
    angle = np.arctan2(*(end - start)[::-1])
    for share in np.linspace(0, 1, count):
        x, y = start + (end - start) * share
        for side in (-1, 1):
            turn = angle + side * rng.uniform(0.45, 1.15)
            length = 32 * rng.uniform(0.7, 1.15)
            tip = _point(x + length * np.cos(turn), y + length * np.sin(turn))
            cv2.line(canvas, _point(x, y), tip, _ink((46, 66, 34), rng.uniform(0.5, 1.35)), 4)


def _draw_fir_twig(rng: np.random.Generator, canvas: Float) -> None:
    size = canvas.shape[0]
    middle = size // 2
    cv2.line(canvas, (0, middle), (int(size * 0.95), middle), _ink((70, 54, 40), 1), 11)
    for share in 0.04 + 0.88 * np.arange(19) / 19:
        for side in (-1, 1):
            if rng.random() < 0.06:
                continue
            length = size * 0.47 * (1 - share) ** 0.75 * rng.uniform(0.7, 1.02)
            angle = side * rng.uniform(0.75, 1.0)
            start = np.array([size * share, middle])
            end = start + length * np.array([0.8 * np.cos(angle), np.sin(angle)])
            cv2.line(canvas, _point(*start), _point(*end), _ink((70, 56, 42), 1), 5)
            _needles(rng, canvas, start, end, int(length / 9) + 3)
    _needles(rng, canvas, np.array([0.0, middle]), np.array([size * 0.96, middle]), 110)


def _draw_leaves(rng: np.random.Generator, canvas: Float) -> None:
    size = canvas.shape[0]
    middle = size // 2
    cv2.line(canvas, (0, middle), (int(size * 0.88), middle), _ink((84, 70, 50), 1), 7)
    for _ in range(60):
        share = rng.uniform(0.08, 0.94)
        spread = 0.4 * np.sin(np.pi * min(1.0, share * 1.02)) ** 0.6
        base = np.array([size * share, size * (0.5 + rng.uniform(-spread, spread))])
        angle, length = rng.uniform(-0.9, 0.9), rng.uniform(55, 95)
        along = np.array([np.cos(angle), np.sin(angle)]) * length
        across = np.array([-along[1], along[0]]) * 0.34
        steps = ((0, 0), (0.3, 1), (0.65, 0.8), (1, 0), (0.65, -0.8), (0.3, -1))
        outline = np.array([base + along * a + across * b for a, b in steps], np.int32)
        root = _point(max(0.0, base[0] - abs(base[1] - middle) * 0.8), middle)
        strength = rng.uniform(0.6, 1.25)
        cv2.line(canvas, root, _point(*base), _ink((84, 70, 50), 1), 4)
        cv2.fillPoly(canvas, [outline], _ink((70, 100, 36), strength))
        cv2.line(canvas, _point(*base), _point(*(base + along)), _ink((96, 124, 56), strength), 3)


def _draw_grass(rng: np.random.Generator, canvas: Float) -> None:
    size = canvas.shape[0]
    for _ in range(60):
        foot, height = size * rng.normal(0.5, 0.13), size * rng.uniform(0.3, 0.97)
        bend, width = rng.normal(0, 0.2) * size, rng.uniform(5, 11)
        share = np.linspace(0, 1, 9)
        x = foot + bend * share**2
        y = size - height * share + 0.25 * abs(bend) * share**3
        left = np.stack([x - width * (1 - share), y], -1)
        right = np.stack([x + width * (1 - share), y], -1)
        base = (122, 106, 64) if rng.random() < 0.25 else (78, 98, 42)
        outline = np.concatenate([left, right[::-1]]).astype(np.int32)
        cv2.fillPoly(canvas, [outline], _ink(base, rng.uniform(0.55, 1.3)))


def _draw_fern(rng: np.random.Generator, canvas: Float) -> None:
    size = canvas.shape[0]
    cv2.line(canvas, (0, size // 2), (int(size * 0.97), size // 2), _ink((80, 84, 40), 1), 8)
    for share in 0.08 + 0.9 * np.arange(30) / 30:
        for side in (-1, 1):
            length = size * 0.42 * np.sin(np.pi * (share * 0.85 + 0.12)) ** 0.8
            length *= rng.uniform(0.85, 1.05)
            turn, strength = side * 1.15, rng.uniform(0.7, 1.2)
            along = np.array([np.cos(turn), np.sin(turn)])
            start = np.array([size * share, size * 0.5])
            for step in np.linspace(0, 1, 14):
                half = size * 0.02 * (1 - step * 0.8)
                axes = (max(1, round(half * 1.5)), max(1, round(half)))
                spot = _point(*(start + along * length * step))
                cv2.ellipse(canvas, spot, axes, side * 25, 0, 360, _ink((66, 98, 34), strength), -1)


def _normals(height: Float) -> Float:
    dx = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * 1.6
    dy = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) * 1.6
    normal = np.stack([-dx, dy, np.ones_like(dx)], -1)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True) * 0.5 + 0.5)


def _mip_levels(layers: Float) -> tuple[Float, NDArray[np.int64]]:
    levels, offsets, start = [], [], 0
    for _ in range(MIP_LEVELS):
        offsets.append(start)
        levels.append(layers.reshape(-1, layers.shape[-1]))
        start += len(levels[-1])
        quads = layers[:, ::2, ::2] + layers[:, 1::2, ::2]
        layers = (quads + layers[:, ::2, 1::2] + layers[:, 1::2, 1::2]) / 4
    return np.concatenate(levels), np.array(offsets, np.int64)


def make_textures(seed: int = 0) -> Textures:
    """Draw every layer; the same seed gives the same bytes."""
    rng = np.random.default_rng(seed)
    solid = {
        Layer.FIR_BARK: _fir_bark(rng),
        Layer.BEECH_BARK: _beech_bark(rng),
        Layer.LITTER: _litter(rng),
        Layer.MOSS: _moss(rng),
        Layer.CUT_WOOD: _cut_wood(rng),
    }
    bark, relief = solid[Layer.FIR_BARK]
    solid[Layer.DEAD_WOOD] = (bark * 0.5 + 0.45 * _rgb(118, 108, 100), relief * 0.5)
    cutouts = {
        Layer.FIR_TWIG: _cutout(rng, _draw_fir_twig, (38, 54, 28)),
        Layer.LEAVES: _cutout(rng, _draw_leaves, (64, 90, 34)),
        Layer.GRASS: _cutout(rng, _draw_grass, (72, 88, 40)),
        Layer.FERN: _cutout(rng, _draw_fern, (62, 90, 34)),
    }
    opaque, flat = np.ones((SIZE_PX, SIZE_PX, 1)), np.zeros((SIZE_PX, SIZE_PX))
    colour = [
        cutouts[layer] if layer in cutouts else np.concatenate([solid[layer][0], opaque], -1)
        for layer in Layer
    ]
    heights = [flat if layer in cutouts else solid[layer][1] for layer in Layer]
    linear = np.clip(np.stack(colour), 0, 1).astype(np.float32)
    linear[..., :3] **= 2.2
    albedo, offsets = _mip_levels(linear)
    albedo[:, :3] = np.sqrt(albedo[:, :3])
    normals, _ = _mip_levels(np.stack([_normals(height) for height in heights]).astype(np.float32))
    packed = (albedo * 255 + 0.5).astype(np.uint8)
    return Textures(packed, packed[:, 3].copy(), (normals * 255 + 0.5).astype(np.uint8), offsets)
