"""Arguments of the shading kernels: triangles, textures, camera, light and weather."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Float32, Int32, Int64, UInt8


class Surface(NamedTuple):
    """Triangles of the scene. The values of a vertex are adjacent in memory, for the CPU cache.

    Attributes:
        screen: (V, 3) projected vertices: x px, y px and 1 / z.
        faces: (F, 3) vertex numbers.
        layer: (F,) texture layer.
        corners: (V, 8) per vertex: normal x, y, z, texture u, v, tint, sky visibility, 0.
        ground_m: (G, G) ground heights on 1 m cells around the origin, m.
        cover: (4,) fractions of the ground covers.
    """

    screen: Float32
    faces: Int32
    layer: UInt8
    corners: Float32
    ground_m: Float32
    cover: Float32


class Triangles(NamedTuple):
    """Triangles to rasterise, on the screen.

    Attributes:
        screen: (V, 3) projected vertices: x px, y px and 1 / z or nearness.
        faces: (F, 3) vertex numbers.
        uv: (V, 2) texture coordinates.
        layer: (F,) texture layers.
        alpha: (N,) alpha of all layers and mip levels.
        offsets: (levels,) first texel of each mip level.
        perspective: Whether the projection is perspective, so that texture coordinates must be
            corrected.
    """

    screen: Float32
    faces: Int32
    uv: Float32
    layer: UInt8
    alpha: UInt8
    offsets: Int64
    perspective: bool


class FarStand(NamedTuple):
    """A photographed sky and far stand around the scene.

    Attributes:
        root: (H, W, 3) uint8 square root of linear RGB, from zenith to nadir; a single row for
            none.
        view: (3,) whole number by which its angles along the horizon are divided, bearing of its
            first column in turns of the panorama, and factor that brings its sky to a luminance
            of 1.
    """

    root: UInt8
    view: Float32


class Maps(NamedTuple):
    """Textures, far stand and the sun's shadow map.

    Attributes:
        albedo: (N, 4) square root of linear RGB, and alpha, all layers and mip levels.
        relief: (N, 3) normals.
        offsets: (levels,) first texel of each mip level.
        texture_layer: (layers,) number of the layer whose texture each layer shows.
        gains: (layers, 3) factors of the linear RGB colours.
        shadow: (S, S) nearness to the sun.
        shadow_rows: (3, 4) matrix from world metres to shadow map x, y and nearness.
        shadow_bias: Nearness tolerance of the shadow test.
        far_root: Photographed far stand, as in FarStand.
        far_view: How it is seen, as in FarStand.
    """

    albedo: UInt8
    relief: UInt8
    offsets: Int64
    texture_layer: Int64
    gains: Float32
    shadow: Float32
    shadow_rows: Float32
    shadow_bias: np.float32
    far_root: UInt8
    far_view: Float32


class SampleCamera(NamedTuple):
    """Camera of the sample grid.

    Attributes:
        origin: (3,) position in the world, m.
        rotation: (3, 3) axes in the world; the rows are right, down and forward.
        focal_x: Horizontal focal length, samples.
        focal_y: Vertical focal length, samples.
        centre_x: Principal point, samples.
        centre_y: Principal point, samples.
    """

    origin: Float32
    rotation: Float32
    focal_x: np.float32
    focal_y: np.float32
    centre_x: np.float32
    centre_y: np.float32


class Atmosphere(NamedTuple):
    """Light and weather.

    Attributes:
        sun: (3,) unit vector towards the sun.
        sun_colour: (3,) linear RGB.
        sky_colour: (3,) linear RGB.
        haze_colour: (3,) linear RGB.
        haze_per_m: Extinction of the air, 1/m.
        snow: Amount of lying snow, 0 to 1.
        wet: Wetness of surfaces, 0 to 1.
        backdrop: Density of the forest beyond the stand, 0 to 1; 0 draws a plain silhouette.
        backdrop_seed: Decides where its trunks stand.
        lamp: Strength of a lamp at the camera, 0 for none.
        infrared: 1 if the lamp is infrared, else 0.
    """

    sun: Float32
    sun_colour: Float32
    sky_colour: Float32
    haze_colour: Float32
    haze_per_m: np.float32
    snow: np.float32
    wet: np.float32
    backdrop: np.float32
    backdrop_seed: np.float32
    lamp: np.float32
    infrared: np.float32
