"""Draws a scene: the sun's shadow map once, then colour, depth and labels for every view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.camera import View, visible_faces
from perceptree.simulator.mesh import UP, unit
from perceptree.simulator.rasterise import (
    BANDS,
    bin_faces,
    draw_faces,
    project_parallel,
    project_vertices,
)
from perceptree.simulator.scene import Scene
from perceptree.simulator.shade import Eye, Illumination, Maps, Surface, shade_samples
from perceptree.simulator.textures import Textures

Float = NDArray[np.floating[Any]]

SUPERSAMPLING = 2
_SHADOW_PX = 2048
_SHADOW_RADIUS_M = 30.0
_SHADOW_DEPTH_M = 90.0
_SHADOW_BIAS_M = 0.05


@dataclass(frozen=True)
class Drawing:
    """What one view shows.

    ``samples`` (2H, 2W, 3) float32 linear RGB and ``log_luminance`` their mean log; ``depth_m``
    (H, W) float32 along the optical axis, 0 on sky; ``object_id`` (H, W) int32 labelled tree or 0.
    """

    samples: NDArray[np.float32]
    log_luminance: float
    depth_m: NDArray[np.float32]
    object_id: NDArray[np.int32]


@dataclass(frozen=True)
class _Buffers:
    near: NDArray[np.float32]
    seen: NDArray[np.int32]


class Renderer:
    """Draws views of one scene; the shadow map is made when the scene is set."""

    def __init__(self, textures: Textures, scene: Scene) -> None:
        self._textures = textures
        self._scene = scene
        self._screen = np.empty((len(scene.vertices), 3), np.float32)
        self._shadow_rows = self._sun_matrix()
        project_parallel(scene.vertices, self._shadow_rows, self._screen)
        numbers = np.arange(len(scene.faces))
        self._shadow = self._rasterise(numbers, _SHADOW_PX, _SHADOW_PX, perspective=False).near

    def _sun_matrix(self) -> NDArray[np.float32]:
        """(3, 4) rows from world metres to shadow-map x px, y px and nearness in (0, 1)."""
        sun = self._scene.light.sun
        right = unit(np.cross(UP, sun)) if abs(sun[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
        down = np.cross(right, sun)
        middle = np.array([0.0, 0.0, float(self._scene.terrain.height_m(0.0, 0.0)) + 5.0])
        scale = _SHADOW_PX / (2 * _SHADOW_RADIUS_M)
        axes = np.stack([right * scale, down * scale, sun / _SHADOW_DEPTH_M])
        shift = np.array([_SHADOW_PX / 2, _SHADOW_PX / 2, 0.5]) - axes @ middle
        return np.concatenate([axes, shift[:, None]], 1).astype(np.float32)

    def _rasterise(
        self, numbers: NDArray[np.int64], width: int, height: int, perspective: bool
    ) -> _Buffers:
        scene, textures = self._scene, self._textures
        faces, layer = scene.faces[numbers], scene.layer[numbers]
        counts = np.zeros(BANDS, np.int64)
        lists = np.empty((BANDS, len(faces)), np.int32)
        bin_faces(self._screen, faces, width, height, counts, lists)
        near = np.empty((height, width), np.float32)
        seen = np.empty((height, width), np.int32)
        draw_faces(
            self._screen, faces, scene.uv, layer, textures.alpha, textures.offsets, counts, lists,
            perspective, near, seen,
        )  # fmt: skip
        return _Buffers(near, seen)

    def _project(self, view: View, scale: int) -> tuple[int, int]:
        camera = view.intrinsics
        project_vertices(
            self._scene.vertices, view.rotation.astype(np.float32), view.origin.astype(np.float32),
            np.float32(camera.fx * scale), np.float32((camera.cx + 0.5) * scale),
            np.float32((camera.cy + 0.5) * scale), self._screen,
        )  # fmt: skip
        return camera.width * scale, camera.height * scale

    def draw(self, view: View) -> Drawing:
        """Colour from four samples a pixel; depth and labels from the pixel's centre."""
        numbers = visible_faces(self._scene, view)
        width, height = self._project(view, 1)
        exact = self._rasterise(numbers, width, height, perspective=True)
        hit = exact.seen >= 0
        depth_m = np.where(hit, 1 / np.where(hit, exact.near, 1), 0).astype(np.float32)
        objects = self._scene.object_id[numbers]
        object_id = np.where(hit, objects[np.where(hit, exact.seen, 0)], 0).astype(np.int32)
        samples, log_luminance = self._shade(view, numbers)
        return Drawing(samples, log_luminance, depth_m, object_id)

    def _shade(self, view: View, numbers: NDArray[np.int64]) -> tuple[NDArray[np.float32], float]:
        width, height = self._project(view, SUPERSAMPLING)
        buffers = self._rasterise(numbers, width, height, perspective=True)
        scene, light, textures = self._scene, self._scene.light, self._textures
        samples = np.empty((height, width, 3), np.float32)
        log_sum = np.empty(height, np.float32)
        f = np.float32
        surface = Surface(
            self._screen, scene.faces[numbers], scene.layer[numbers], scene.normals, scene.uv,
            scene.tint, scene.sky, f(scene.terrain.height_m(*view.origin[:2])),
        )  # fmt: skip
        maps = Maps(
            textures.albedo, textures.normals, textures.offsets, self._shadow, self._shadow_rows,
            f(_SHADOW_BIAS_M / _SHADOW_DEPTH_M),
        )  # fmt: skip
        eye = Eye(view.origin.astype(f), view.rotation.astype(f),
                  f(view.intrinsics.fx * SUPERSAMPLING))  # fmt: skip
        illumination = Illumination(
            light.sun.astype(f), light.sun_colour.astype(f), light.sky_colour.astype(f),
            light.haze_colour.astype(f), f(light.haze_per_m),
        )  # fmt: skip
        shade_samples(buffers.near, buffers.seen, surface, maps, eye, illumination, samples,
                      log_sum)  # fmt: skip
        return samples, float(log_sum.sum(dtype=np.float64) / (width * height))
