"""Triangle meshes, and functions that make tubes and cards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Bool, Float
from perceptree.simulator.vectors import UP, unit

Int = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh with z up.

    Attributes:
        vertices: (V, 3) m.
        normals: (V, 3).
        uv: (V, 2) texture coordinates, in repeats.
        tint: (V,) brightness factors.
        faces: (F, 3) vertex numbers.
        layer: (F,) texture layers.
        labelled: (F,) bool, whether a face belongs to a tree's labelled lower stem.
    """

    vertices: Float
    normals: Float
    uv: Float
    tint: Float
    faces: Int
    layer: Int
    labelled: Bool


class Kind(NamedTuple):
    """A kind of mesh that scenes place.

    Attributes:
        make: Makes one variant, which stands on z = 0.
        variants: Number of variants that scenes choose from.
    """

    make: Callable[[np.random.Generator], Mesh]
    variants: int


def make_mesh(
    vertices: Float, normals: Float, uv: Float, faces: Int, layer: int, tint: Float | float = 1.0
) -> Mesh:
    """Make a mesh of one texture layer without labelled faces, with arguments as in Mesh."""
    return Mesh(
        vertices,
        normals,
        uv,
        np.broadcast_to(np.asarray(tint, np.float32), (len(vertices),)),
        faces,
        np.full(len(faces), layer, np.uint8),
        np.zeros(len(faces), np.bool_),
    )


def merge(meshes: list[Mesh]) -> Mesh:
    """Concatenate meshes."""
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]).astype(np.float32),
        np.concatenate([mesh.normals for mesh in meshes]).astype(np.float32),
        np.concatenate([mesh.uv for mesh in meshes]).astype(np.float32),
        np.concatenate([mesh.tint for mesh in meshes]).astype(np.float32),
        np.concatenate([m.faces + o for m, o in zip(meshes, offsets, strict=True)]).astype(
            np.int32
        ),
        np.concatenate([mesh.layer for mesh in meshes]),
        np.concatenate([mesh.labelled for mesh in meshes]),
    )


def ring_frames(centres: Float) -> tuple[Float, Float]:
    """Two perpendicular unit vectors (n, K, 3) across curves (n, K, 3) at each of their points."""
    tangent = unit(np.gradient(centres, axis=1))
    reference = np.where(np.abs(tangent[..., 2:]) > 0.8, np.array([1.0, 0.0, 0.0]), UP)
    first = unit(np.cross(reference, tangent))
    return first, np.cross(tangent, first)


def tube_faces(tubes: int, rings: int, sides: int) -> Int:
    """(F, 3) triangles of tubes whose vertices are ordered as (tubes, rings, sides + 1)."""
    grid = np.arange(tubes * rings * (sides + 1)).reshape(tubes, rings, sides + 1)
    lower, upper = grid[:, :-1], grid[:, 1:]
    first = np.stack([lower[..., :-1], lower[..., 1:], upper[..., 1:]], -1)
    second = np.stack([lower[..., :-1], upper[..., 1:], upper[..., :-1]], -1)
    return np.stack([first, second], -2).reshape(-1, 3)


def card_faces(cards: int, vertices: int, quads: list[list[int]]) -> Int:
    """(F, 3) triangles of cards, each with a number of vertices and the same quads (Q, 4)."""
    corners = np.array(quads)
    local = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    return np.asarray(np.arange(cards)[:, None, None] * vertices + local).reshape(-1, 3)


def surface_mesh(
    vertices: Float, centres: Float, layer: int, repeats: float, repeat_length_m: float, tint: float
) -> Mesh:
    """Make tubes from their rings.

    Args:
        vertices: (n, K, S + 1, 3) rings; the first and last point of a ring are equal, m.
        centres: (n, K, 3) centres of the rings, m.
        layer: Texture layer.
        repeats: Repeats of the texture around a tube.
        repeat_length_m: Length of one repeat along a tube, m.
        tint: Brightness factor.
    """
    tubes, rings, corners, _ = vertices.shape
    around = np.gradient(vertices, axis=2)
    around[:, :, 0] = around[:, :, -1] = vertices[:, :, 1] - vertices[:, :, -2]
    normals = unit(np.cross(around, np.gradient(vertices, axis=1)))
    outwards = ((vertices - centres[:, :, None]) * normals).sum(-1, keepdims=True)
    normals = np.where(outwards < 0, -normals, normals)
    steps = np.linalg.norm(np.diff(centres, axis=1), axis=-1)
    along = np.concatenate([np.zeros((tubes, 1)), np.cumsum(steps, 1)], 1) / repeat_length_m
    turn = np.linspace(0.0, repeats, corners)
    uv = np.stack(np.broadcast_arrays(turn[None, None], along[..., None]), -1)
    return make_mesh(
        vertices.reshape(-1, 3),
        normals.reshape(-1, 3),
        uv.reshape(-1, 2),
        tube_faces(tubes, rings, corners - 1),
        layer,
        tint,
    )


def tubes_mesh(
    centres: Float, radius_m: Float, sides: int, layer: int, tint: float, repeat_length_m: float
) -> Mesh:
    """Make round tubes along curves.

    Args:
        centres: (n, K, 3) points of the curves, m.
        radius_m: (n, K) radii, m.
        sides: Sides of a tube.
        layer: Texture layer.
        tint: Brightness factor.
        repeat_length_m: Length of one texture repeat along a tube, m.
    """
    first, second = ring_frames(centres)
    angle = np.linspace(0.0, 2 * np.pi, sides + 1)
    across = (
        np.cos(angle)[:, None] * first[:, :, None] + np.sin(angle)[:, None] * second[:, :, None]
    )
    vertices = centres[:, :, None] + across * radius_m[..., None, None]
    return surface_mesh(vertices, centres, layer, 1.0, repeat_length_m, tint)


class Cards(NamedTuple):
    """Rectangles for textures with alpha, which plants are composed of.

    Attributes:
        feet: (n, 3) middles of their lower ends, m.
        axes: (n, 3) unit vectors along them.
        sides: (n, 3) unit vectors across them.
        length_m: (n,) lengths, m.
        width_m: (n,) widths, m.
    """

    feet: Float
    axes: Float
    sides: Float
    length_m: Float
    width_m: Float


def cards_mesh(cards: Cards, centre: Float, layer: int, tint: Float, droop: float) -> Mesh:
    """Make bent, folded twigs.

    Args:
        cards: The twigs.
        centre: (n, 3) points from which the normals are bent away, so that the shading of the
            foliage shows volume, m.
        layer: Texture layer.
        tint: (n,) brightness factors.
        droop: How far the tips hang down, as a fraction of the length.
    """
    feet, axes, sides, length_m, width_m = cards
    count = len(feet)
    points, coordinates = [], []
    for fraction, lift in ((0.0, 0.0), (0.5, 0.06), (1.0, -droop)):
        spine = feet + axes * (length_m * fraction)[:, None] + UP * (length_m * lift)[:, None]
        for side in (-0.5, 0.0, 0.5):
            fold = UP * (width_m * 0.16 * (0.5 - abs(side)))[:, None]
            points.append(spine + sides * (width_m * side)[:, None] + fold)
            coordinates.append(np.tile([fraction, side + 0.5], (count, 1)))
    vertices = np.stack(points, 1)
    flat = unit(np.cross(vertices[:, 6] - vertices[:, 0], vertices[:, 2] - vertices[:, 0]))
    flat = np.where(flat[:, 2:] < 0, -flat, flat)
    normals = unit(flat[:, None] + 0.9 * unit(vertices - centre[:, None]))
    return make_mesh(
        vertices.reshape(-1, 3),
        normals.reshape(-1, 3),
        np.stack(coordinates, 1).reshape(-1, 2),
        card_faces(count, 9, [[0, 3, 4, 1], [1, 4, 5, 2], [3, 6, 7, 4], [4, 7, 8, 5]]),
        layer,
        np.repeat(tint, 9),
    )
