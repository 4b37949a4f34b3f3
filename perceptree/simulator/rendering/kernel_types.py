"""What the shading kernels read: the scene's arrays, textures, camera, light and weather."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


class Surface(NamedTuple):
    """Triangles as in ``SceneMesh``, their corners' values side by side for the cache.

    ``screen`` (V, 3) projected; ``corners`` (V, 8): normal x, y, z, u, v, tint, sky and 0;
    ``ground_m`` (G, G) heights on cells of 1 m around the origin; ``cover`` (4,) the shares of
    the grounds.
    """

    screen: Floats
    faces: NDArray[np.int32]
    layer: NDArray[np.uint8]
    corners: Floats
    ground_m: Floats
    cover: Floats


class Maps(NamedTuple):
    """Textures with their mip offsets, and the sun's shadow map with its (3, 4) matrix.

    ``worn`` (layers,) is the number of the layer whose texture each layer shows; ``gains``
    (layers, 3) multiply its linear RGB colour.
    """

    albedo: NDArray[np.uint8]
    relief: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    worn: NDArray[np.int64]
    gains: Floats
    shadow: Floats
    shadow_rows: Floats
    shadow_bias: np.float32


class Eye(NamedTuple):
    """Camera of the samples: origin (3,), rows right, down, forward (3, 3), focal and centre px."""

    origin: Floats
    rotation: Floats
    focal_x: np.float32
    focal_y: np.float32
    centre_x: np.float32
    centre_y: np.float32


class Air(NamedTuple):
    """Direction to the sun and linear RGB colours, (3,) each, haze per metre, snow and wetness.

    ``backdrop`` is how dense the forest beyond the stand is, 0 for a plain wall, ``backdrop_seed``
    decides where its trunks stand; ``lamp`` is the strength of a lamp at the camera.
    """

    sun: Floats
    sun_colour: Floats
    sky_colour: Floats
    haze_colour: Floats
    haze_per_m: np.float32
    snow: np.float32
    wet: np.float32
    backdrop: np.float32
    backdrop_seed: np.float32
    lamp: np.float32
