"""Renders a scene: the sun's shadow map once, then colour, depth and labels of every view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from basetree.arrays import Float32, Int32, Int64
from perceptree.simulator.geometry.assemble import SceneMesh
from perceptree.simulator.materials.textures import Textures
from perceptree.simulator.rendering.grid import SampleGrid, sample_grid
from perceptree.simulator.rendering.kernel_types import (
    Atmosphere,
    FarStand,
    Maps,
    SampleCamera,
    Surface,
    Triangles,
)
from perceptree.simulator.rendering.rasterise import (
    BANDS,
    bin_faces,
    draw_faces,
    project_parallel,
    project_vertices,
)
from perceptree.simulator.rendering.shade import shade_samples
from perceptree.simulator.rendering.view import View, visible_faces
from perceptree.simulator.scene.description import Scene
from perceptree.simulator.scene.terrain import EXTENT_M
from perceptree.simulator.vectors import UP, unit

_f32 = np.float32

_SHADOW_PX = 2048
_SHADOW_RADIUS_M = 30.0
_SHADOW_DEPTH_M = 120.0
_SHADOW_BIAS_M = 0.05
_LEAST_SUN = 0.03  # weaker suns cast no shadow
_BACKDROPS = 997  # number of different backdrops
_NO_FAR_STAND = FarStand(np.zeros((1, 1, 3), np.uint8), np.ones(3, np.float32))


@dataclass(frozen=True)
class Drawing:
    """A rendered view.

    Attributes:
        samples: (2H, 2W, 3) float32 linear RGB; every second sample is at a pixel centre.
        log_luminance: Mean of the logarithm of the samples' luminance.
        depth_m: (H, W) float32, depth along the optical axis at pixel centres, m; 0 on sky.
        object_id: (H, W) int32, number of the labelled tree (from 1), else 0.
    """

    samples: Float32
    log_luminance: float
    depth_m: Float32
    object_id: Int32


class _Buffers(NamedTuple):
    depth_buffer: Float32
    face_buffer: Int32


class Renderer:
    """Renders views of one scene. The shadow map is rendered on construction.

    Args:
        textures: Textures of all layers.
        scene: The scene's light and weather.
        mesh: The scene's triangles.
        far_stand: Photographed far stand in place of the procedural background.
        far_forest: Whether the procedural forest beyond the stand is drawn.
    """

    def __init__(
        self,
        textures: Textures,
        scene: Scene,
        mesh: SceneMesh,
        far_stand: FarStand | None = None,
        far_forest: bool = True,
    ) -> None:
        self._textures = textures
        self._scene = scene
        self._mesh = mesh
        self._screen = np.empty((len(mesh.vertices), 3), np.float32)
        self._corners = _corners(mesh)
        self._far_stand = far_stand or _NO_FAR_STAND
        self._atmosphere = _atmosphere(scene, far_forest)
        self._ground_m = _ground_grid(scene)
        self._shadow_rows = self._sun_matrix()
        self._shadow = self._draw_shadow()

    def _sun_matrix(self) -> Float32:
        """(3, 4) matrix from world metres to shadow map x px, y px and nearness (0 to 1)."""
        sun = self._scene.light.sun
        right = unit(np.cross(UP, sun)) if abs(sun[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
        down = np.cross(right, sun)
        middle = np.array([0.0, 0.0, float(self._scene.terrain.height_m(0.0, 0.0)) + 5.0])
        scale = _SHADOW_PX / (2 * _SHADOW_RADIUS_M)
        axes = np.stack([right * scale, down * scale, sun / _SHADOW_DEPTH_M])
        shift = np.array([_SHADOW_PX / 2, _SHADOW_PX / 2, 0.5]) - axes @ middle
        return np.concatenate([axes, shift[:, None]], 1).astype(np.float32)

    def _draw_shadow(self) -> Float32:
        """(S, S) nearness to the sun; all zero if the sun is too weak to cast shadows."""
        if self._scene.light.sun_colour.max() < _LEAST_SUN:
            return np.zeros((2, 2), np.float32)
        project_parallel(self._mesh.vertices, self._shadow_rows, self._screen)
        numbers = np.arange(len(self._mesh.faces))
        return self._rasterise(numbers, _SHADOW_PX, _SHADOW_PX, perspective=False).depth_buffer

    def _rasterise(self, numbers: Int64, width: int, height: int, perspective: bool) -> _Buffers:
        mesh, textures = self._mesh, self._textures
        faces, layer = mesh.faces[numbers], mesh.layer[numbers]
        counts = np.zeros(BANDS, np.int64)
        lists = np.empty((BANDS, len(faces)), np.int32)
        bin_faces(self._screen, faces, width, height, counts, lists)
        depth_buffer = np.empty((height, width), np.float32)
        face_buffer = np.empty((height, width), np.int32)
        triangles = Triangles(
            self._screen, faces, mesh.uv, layer, textures.alpha, textures.offsets, perspective
        )
        draw_faces(triangles, counts, lists, depth_buffer, face_buffer)
        return _Buffers(depth_buffer, face_buffer)

    def draw(self, view: View) -> Drawing:
        """Render colour at twice the image resolution, and depth and labels at pixel centres."""
        grid = sample_grid(view)
        numbers = visible_faces(self._mesh, view)
        camera = _sample_camera(view, grid)
        project_vertices(self._mesh.vertices, camera, self._screen)
        buffers = self._rasterise(numbers, grid.width, grid.height, perspective=True)
        samples, log_luminance = self._shade(camera, grid, numbers, buffers)
        seen = np.asarray(grid.nearest(buffers.face_buffer), np.int32)
        hit = seen >= 0
        if grid.distorted:
            near = grid.nearness(self._screen[self._mesh.faces[numbers[seen]]])
        else:
            near = np.asarray(grid.nearest(buffers.depth_buffer), np.float32)
        depth_m = np.where(hit, 1 / np.where(hit, near, 1), 0).astype(np.float32)
        objects = self._mesh.object_id[numbers]
        object_id = np.where(hit, objects[np.where(hit, seen, 0)], 0).astype(np.int32)
        return Drawing(grid.resample(samples), log_luminance, depth_m, object_id)

    def _shade(
        self, camera: SampleCamera, grid: SampleGrid, numbers: Int64, buffers: _Buffers
    ) -> tuple[Float32, float]:
        mesh, textures = self._mesh, self._textures
        samples = np.empty((grid.height, grid.width, 3), np.float32)
        log_sum = np.empty(grid.height // 2, np.float32)
        surface = Surface(
            self._screen,
            mesh.faces[numbers],
            mesh.layer[numbers],
            self._corners,
            self._ground_m,
            self._scene.terrain.cover.astype(_f32),
        )
        maps = Maps(
            textures.albedo,
            textures.normals,
            textures.offsets,
            self._scene.appearance.texture_layer,
            self._scene.appearance.gains.astype(_f32),
            self._shadow,
            self._shadow_rows,
            _f32(_SHADOW_BIAS_M / _SHADOW_DEPTH_M),
            self._far_stand.root,
            self._far_stand.view,
        )
        shade_samples(*buffers, surface, maps, camera, self._atmosphere, samples, log_sum)
        blocks = (grid.height // 2) * (grid.width // 2)
        return samples, float(log_sum.sum(dtype=np.float64) / blocks)


def _sample_camera(view: View, grid: SampleGrid) -> SampleCamera:
    lengths = (grid.focal_x, grid.focal_y, grid.centre_x, grid.centre_y)
    return SampleCamera(
        view.origin.astype(_f32), view.rotation.astype(_f32), *(_f32(each) for each in lengths)
    )


def _corners(mesh: SceneMesh) -> Float32:
    """(V, 8) values of each vertex, as in `kernel_types.Surface`."""
    corners = np.zeros((len(mesh.vertices), 8), np.float32)
    corners[:, :3], corners[:, 3:5] = mesh.normals, mesh.uv
    corners[:, 5], corners[:, 6] = mesh.tint, mesh.sky
    return corners


def _atmosphere(scene: Scene, far_forest: bool) -> Atmosphere:
    light, weather, gains = scene.light, scene.weather, scene.appearance.sky_gains
    return Atmosphere(
        light.sun.astype(_f32),
        (light.sun_colour * gains).astype(_f32),
        (light.sky_colour * gains).astype(_f32),
        (light.haze_colour * gains).astype(_f32),
        _f32(weather.haze_per_m),
        _f32(weather.snow),
        _f32(weather.wet),
        _f32(scene.backdrop if far_forest else 0),
        _f32(scene.seed % _BACKDROPS),
        _f32(light.lamp),
        _f32(light.infrared),
    )


def _ground_grid(scene: Scene) -> Float32:
    """(G, G) ground heights at the centres of 1 m cells, m."""
    middle = np.arange(-EXTENT_M, EXTENT_M) + 0.5
    x, y = np.meshgrid(middle, middle)
    return scene.terrain.height_m(x, y).astype(np.float32)
