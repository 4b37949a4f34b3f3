"""The renderer agrees with an independent ray caster, Embree, on surfaces and depth."""

import dataclasses

import numpy as np
import pytest
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

import calib
from perceptree.simulator.geometry.assemble import SceneMesh
from perceptree.simulator.materials.layers import FIRST_CUTOUT, FIRST_OBJECT
from perceptree.simulator.materials.textures import Textures
from perceptree.simulator.rendering.grid import SUPERSAMPLING, sample_grid
from perceptree.simulator.rendering.render import Renderer
from perceptree.simulator.rendering.view import View, random_view
from perceptree.simulator.scene.description import Scene
from perceptree.simulator.settings import SimulatorSettings

BARREL = (-0.3, 0.08, 0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Seen:
    """Per pixel: the face (-1 on sky), the instance and the labelled tree, and the depth."""

    face: np.ndarray
    instance: np.ndarray
    tree: np.ndarray
    depth_m: np.ndarray


def opaque_part(mesh: SceneMesh) -> SceneMesh:
    kept = (mesh.layer < FIRST_CUTOUT) | (mesh.layer >= FIRST_OBJECT)
    before = np.concatenate([[0], np.cumsum(kept)])
    return dataclasses.replace(
        mesh,
        faces=mesh.faces[kept],
        layer=mesh.layer[kept],
        object_id=mesh.object_id[kept],
        instance_start=before[mesh.instance_start],
    )


def seen(mesh: SceneMesh, face: np.ndarray, depth_m: np.ndarray) -> Seen:
    instances = np.repeat(np.arange(len(mesh.instance_centre)), np.diff(mesh.instance_start))
    return Seen(
        face,
        np.where(face >= 0, instances[face], -1),
        np.where(face >= 0, mesh.object_id[face], 0),
        depth_m,
    )


def drawn(textures: Textures, scene: Scene, mesh: SceneMesh, views: list[View]) -> list[Seen]:
    """The rasteriser's result; faces are read from a mesh whose object numbers are its faces."""
    numbers = np.arange(1, len(mesh.faces) + 1, dtype=np.int32)
    renderer = Renderer(textures, scene, dataclasses.replace(mesh, object_id=numbers))
    drawings = [renderer.draw(view) for view in views]
    return [seen(mesh, drawing.object_id - 1, drawing.depth_m) for drawing in drawings]


def cast(mesh: SceneMesh, view: View, rays: np.ndarray) -> Seen:
    """Embree's hits along (H, W, 3) camera rays with z = 1, so that distance is depth.

    The scene is moved to the camera in float64: Embree computes in float32.
    """
    vertices = view.to_camera(mesh.vertices.astype(np.float64)).astype(np.float32)
    scene = rtcore_scene.EmbreeScene(robust=True)
    TriangleMesh(scene, vertices, mesh.faces)
    directions = rays.reshape(-1, 3).astype(np.float32)
    hits = scene.run(np.zeros_like(directions), directions, output=True)
    face = hits["primID"].reshape(rays.shape[:2])
    return seen(mesh, face, np.where(face >= 0, hits["tfar"].reshape(face.shape), 0))


def pixel_rays(view: View) -> np.ndarray:
    camera = view.intrinsics
    rows, columns = np.mgrid[: camera.height, : camera.width]
    return calib.pixels_to_rays(camera, np.stack([columns, rows], -1) + 0.5)


def looked_up_rays(view: View) -> np.ndarray:
    """The rays of the buffer samples that a distorted image's pixels use."""
    grid = sample_grid(view)
    step = slice(None, None, SUPERSAMPLING)
    x = (np.rint(grid.columns[step, step]) + 0.5 - grid.centre_x) / grid.focal_x
    y = (np.rint(grid.rows[step, step]) + 0.5 - grid.centre_y) / grid.focal_y
    return np.stack([x, y, np.ones_like(x)], -1)


def beyond(nearest_m: float, raster: Seen, rays: Seen) -> list[Seen]:
    """What both see where the rays meet nothing nearer: a face that reaches behind the camera,
    as a branch at the lens does, is not drawn."""
    kept = (rays.depth_m == 0) | (rays.depth_m > nearest_m)
    assert kept.mean() > 0.9
    return [Seen(*(values[kept] for values in vars(one).values())) for one in (raster, rays)]


def assert_same(raster: Seen, rays: Seen) -> None:
    assert (raster.face >= 0).mean() > 0.3
    assert (raster.tree > 0).mean() > 0.005
    assert (raster.tree == rays.tree).mean() >= 0.999
    assert (raster.instance == rays.instance).mean() >= 0.999
    same = raster.face == rays.face
    assert same.mean() >= 0.999
    gap_m = np.abs(raster.depth_m - rays.depth_m)
    assert (gap_m <= 1e-3).mean() >= 0.9999
    assert gap_m[same].max() <= 2e-3


def views_of(settings: SimulatorSettings, scene: Scene) -> list[View]:
    rngs = [np.random.default_rng([scene.seed, 2, n]) for n in range(3)]
    return [random_view(rng, settings.camera, scene) for rng in rngs]


@pytest.mark.parametrize("which", [0, 1])
def test_a_ray_caster_sees_the_same_faces_at_the_same_depth(
    small_settings, textures, forests, which: int
):
    scene, mesh = forests[which][0], opaque_part(forests[which][1])
    views = views_of(small_settings, scene)
    for view, raster in zip(views, drawn(textures, scene, mesh, views), strict=True):
        assert_same(raster, cast(mesh, view, pixel_rays(view)))


def test_a_ray_caster_sees_the_same_of_clutter_and_objects(field_settings, textures, field_forest):
    scene, mesh = field_forest[0], opaque_part(field_forest[1])
    views = views_of(field_settings, scene)
    for view, raster in zip(views, drawn(textures, scene, mesh, views), strict=True):
        assert_same(*beyond(0.5, raster, cast(mesh, view, pixel_rays(view))))


def test_a_distorted_image_shows_what_its_pixels_rays_hit(small_settings, textures, forests):
    """A distorted pixel shows the face at the nearest sample of a pinhole buffer, up to a quarter
    of a pinhole pixel beside its own ray: ids differ at edges, but only there, and the depth is
    that of the pixel's own ray."""
    scene, mesh = forests[0][0], opaque_part(forests[0][1])
    view = views_of(small_settings, scene)[0]
    camera = dataclasses.replace(view.intrinsics, distortion=BARREL)
    view = dataclasses.replace(view, intrinsics=camera)
    raster = drawn(textures, scene, mesh, [view])[0]
    own, shown = cast(mesh, view, pixel_rays(view)), cast(mesh, view, looked_up_rays(view))
    aside = pixel_rays(view) - looked_up_rays(view)
    assert np.abs(aside[..., 0]).max() <= 0.2501 / camera.fx
    assert np.abs(aside[..., 1]).max() <= 0.2501 / camera.fy
    for name in ("tree", "instance", "face"):
        assert (getattr(raster, name) == getattr(shown, name)).mean() >= 0.999
    assert (raster.tree == own.tree).mean() >= 0.99
    same = raster.face == own.face
    assert same.mean() > 0.6
    gap_m = np.abs(raster.depth_m - own.depth_m)[same]
    assert (gap_m <= 1e-3).mean() >= 0.999
    assert gap_m.max() <= 5e-3
