"""Texture layers: names, numbers and size, shared by geometry, materials and rendering."""

from __future__ import annotations

import enum

SIZE_PX = 512  # width and height of a texture
MIP_LEVELS = 8
PAINT_CELLS = 8  # plain colours along each side of the layer PAINT


class Layer(enum.IntEnum):
    """Texture layers. Those from `FIR_TWIG` to `BILBERRY` are cut out by their alpha.

    `PAINT` contains a grid of plain colours for man-made objects.
    """

    FIR_GREY = 0
    FIR_RESIN = 1
    FIR_MOSSY = 2
    SPRUCE_SCALY = 3
    SPRUCE_GREY = 4
    SPRUCE_LICHEN = 5
    PINE_ORANGE = 6
    PINE_PLATED = 7
    PINE_GREY = 8
    BEECH_SMOOTH = 9
    BEECH_LICHEN = 10
    BEECH_MOSSY = 11
    BIRCH_WHITE = 12
    BIRCH_DARK = 13
    BIRCH_MOSSY = 14
    MAPLE_FURROWED = 15
    MAPLE_GREY = 16
    MAPLE_MOSSY = 17
    DEAD_WOOD = 18
    CUT_WOOD = 19
    ROCK = 20
    LITTER = 21
    MOSS = 22
    ROOTS = 23
    MUD = 24
    FIR_TWIG = 25
    SPRUCE_TWIG = 26
    PINE_TWIG = 27
    BEECH_LEAVES = 28
    BIRCH_LEAVES = 29
    MAPLE_LEAVES = 30
    BARE_TWIG = 31
    GRASS = 32
    DRY_GRASS = 33
    FERN = 34
    SCRUB = 35
    HERB = 36
    BILBERRY = 37
    PAINT = 38
    MASONRY = 39
    FUR = 40


LAST_BARK = Layer.MAPLE_MOSSY
FIRST_GROUND = Layer.LITTER
FIRST_CUTOUT = Layer.FIR_TWIG
FIRST_OBJECT = Layer.PAINT
CROWN_FOLIAGE = (
    Layer.FIR_TWIG,
    Layer.SPRUCE_TWIG,
    Layer.PINE_TWIG,
    Layer.BEECH_LEAVES,
    Layer.BIRCH_LEAVES,
    Layer.MAPLE_LEAVES,
)


def is_cutout(layer: int) -> bool:
    """Whether a layer is cut out by its alpha."""
    return FIRST_CUTOUT <= layer < FIRST_OBJECT
