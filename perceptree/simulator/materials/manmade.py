"""Textures of objects: a grid of plain colours, stone walls and fur."""

from __future__ import annotations

import cv2
import numpy as np

from basetree.arrays import Float
from perceptree.simulator.materials.drawing import mix, noise, rgb
from perceptree.simulator.materials.layers import PAINT_CELLS, SIZE_PX, Layer
from perceptree.simulator.materials.noise import smoothstep

_SAFETY = ((255, 110, 20), (215, 240, 40), (230, 30, 30), (250, 200, 20))
_CLOTH = (
    (40, 60, 110),
    (25, 28, 36),
    (70, 80, 60),
    (120, 120, 125),
    (150, 40, 45),
    (190, 170, 140),
    (95, 70, 50),
    (60, 110, 150),
)
_SKIN = ((224, 172, 140), (198, 140, 105), (120, 80, 55))
_METAL = ((245, 245, 245), (180, 184, 188), (90, 92, 95), (30, 30, 32), (20, 90, 45))


def manmade_layers(rng: np.random.Generator) -> dict[Layer, tuple[Float, Float]]:
    """Draw the textures: colour (H, W, 3) and relief (H, W) by layer."""
    return {Layer.PAINT: _paint(rng), Layer.MASONRY: _masonry(rng), Layer.FUR: _fur(rng)}


def _paint(rng: np.random.Generator) -> tuple[Float, Float]:
    """Cells of one colour each: safety colours, cloth, skin and metal, then random colours."""
    side = SIZE_PX // PAINT_CELLS
    known = [rgb(*colour) for colour in (*_SAFETY, *_CLOTH, *_SKIN, *_METAL)]
    others = rng.random((PAINT_CELLS**2 - len(known), 3)) ** 1.5
    cells = np.concatenate([np.array(known), others]).reshape(PAINT_CELLS, PAINT_CELLS, 3)
    colour = np.repeat(np.repeat(cells, side, 0), side, 1)
    worn = 0.82 + 0.09 * noise(rng, 1.6)[..., None]
    return np.clip(colour * worn, 0, 1), np.zeros((SIZE_PX, SIZE_PX))


def _masonry(rng: np.random.Generator) -> tuple[Float, Float]:
    """Courses of stones in mortar."""
    rows, stones = 8, np.zeros((SIZE_PX, SIZE_PX, 3), np.float32)
    stones[:] = rgb(150, 144, 132)
    height = SIZE_PX // rows
    for row in range(rows):
        x = int(rng.integers(-60, 0))
        while x < SIZE_PX:
            width = int(rng.uniform(0.8, 2.2) * height)
            tone = rgb(122, 116, 108) * rng.uniform(0.65, 1.2)
            corner, end = (x + 3, row * height + 3), (x + width - 3, (row + 1) * height - 3)
            cv2.rectangle(stones, corner, end, tone.tolist(), -1)
            x += width
    rough = noise(rng, 1.8)
    colour = stones * (1 + 0.10 * rough[..., None])
    moss = smoothstep(0.9, 1.6, noise(rng, 2.4))
    return np.clip(mix(colour, rgb(74, 84, 46), 0.7 * moss), 0, 1), 0.6 * rough


def _fur(rng: np.random.Generator) -> tuple[Float, Float]:
    """Short hair along v, with lighter and darker patches."""
    hair, patch = noise(rng, 1.2, 1.0, 10.0), noise(rng, 3.0)
    colour = mix(rgb(120, 92, 66), rgb(176, 150, 120), smoothstep(-2, 2, hair))
    return mix(colour, rgb(70, 56, 44), 0.6 * smoothstep(0.3, 1.4, patch)), 0.3 * hair
