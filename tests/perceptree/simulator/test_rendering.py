"""Rendered views agree with the mesh, whichever part of it is rasterised."""

import dataclasses

import numba
import numpy as np
import pytest

from basetree.errors import SettingsError
from calib import PinholeCamera
from perceptree.simulator.geometry.assemble import SceneMesh
from perceptree.simulator.geometry.ground import ground_mesh
from perceptree.simulator.rendering import render
from perceptree.simulator.rendering.render import Renderer
from perceptree.simulator.rendering.view import Pose, View, look_from, visible_faces
from perceptree.simulator.scene.terrain import make_terrain
from perceptree.simulator.settings import StandSettings, TerrainSettings, ideal_camera


def standing(scene, camera: PinholeCamera, yaw_deg: float = 30.0) -> View:
    eye = np.array([0.0, 0.0, float(scene.terrain.height_m(0.0, 0.0)) + 1.8])
    return look_from(camera, eye, Pose("hand", 1.8, -4.0, 2.0, yaw_deg))


@pytest.fixture(scope="module")
def renderer(textures, forests) -> Renderer:
    return Renderer(textures, *forests[0])


def test_pictures_do_not_depend_on_the_number_of_threads(small_settings, forests, renderer):
    view = standing(forests[0][0], small_settings.camera.intrinsics)
    before = numba.get_num_threads()
    drawings = []
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            drawings.append(renderer.draw(view))
    finally:
        numba.set_num_threads(before)
    first, second = drawings
    assert np.array_equal(first.samples, second.samples)
    assert np.array_equal(first.depth_m, second.depth_m)
    assert np.array_equal(first.object_id, second.object_id)
    assert first.log_luminance == second.log_luminance


@pytest.mark.parametrize("distortion", [(), (-0.3, 0.08, 0.0, 0.0)])
@pytest.mark.parametrize("yaw_deg", [30.0, 200.0])
def test_culling_leaves_out_no_face_that_the_view_shows(
    small_settings, forests, renderer, monkeypatch, yaw_deg: float, distortion
):
    scene, mesh = forests[0]
    camera = dataclasses.replace(small_settings.camera.intrinsics, distortion=distortion)
    view = standing(scene, camera, yaw_deg)
    culled = renderer.draw(view)
    assert len(visible_faces(mesh, view)) < 0.7 * len(mesh.faces)
    every = np.arange(len(mesh.faces))
    monkeypatch.setattr(render, "visible_faces", lambda *_: every)
    whole = renderer.draw(view)
    assert np.array_equal(whole.depth_m, culled.depth_m)
    assert (whole.object_id != culled.object_id).mean() < 1e-4


def test_faces_handed_to_the_rasteriser_grow_with_the_view_and_not_with_the_forest(forests):
    scene, mesh = forests[0]
    counts = [
        len(visible_faces(mesh, standing(scene, ideal_camera(320, 180, fov_deg))))
        for fov_deg in (30.0, 110.0)
    ]
    ground = mesh.instance_start[1]
    assert counts[0] - ground < 0.75 * (counts[1] - ground)
    view = standing(scene, ideal_camera(320, 180))
    behind = 200.0 * view.rotation[2]
    moved = dataclasses.replace(
        mesh,
        instance_start=np.concatenate(
            [mesh.instance_start, mesh.instance_start[-1] + mesh.instance_start[1:]]
        ),
        instance_centre=np.concatenate([mesh.instance_centre, mesh.instance_centre - behind]),
        instance_radius=np.tile(mesh.instance_radius, 2),
    )
    assert np.array_equal(visible_faces(moved, view), visible_faces(mesh, view))


def test_every_face_lies_in_its_instances_sphere(forests):
    mesh: SceneMesh = forests[0][1]
    instance = np.repeat(np.arange(len(mesh.instance_centre)), np.diff(mesh.instance_start))
    gap = mesh.vertices[mesh.faces] - mesh.instance_centre[instance][:, None]
    outside = np.linalg.norm(gap, axis=-1) - mesh.instance_radius[instance][:, None]
    assert outside.max() < 1e-4


def test_ground_height_lies_on_the_grounds_triangles():
    terrain = make_terrain(np.random.default_rng(1), TerrainSettings())
    mesh = ground_mesh(terrain)
    rng = np.random.default_rng(2)
    faces = mesh.faces[rng.integers(len(mesh.faces), size=500)]
    points = (mesh.vertices[faces] * rng.dirichlet(np.ones(3), 500)[..., None]).sum(1)
    assert terrain.height_m(points[:, 0], points[:, 1]) == pytest.approx(points[:, 2], abs=1e-5)


def test_a_shifted_principal_point_shifts_the_picture(small_settings, forests, renderer):
    """Moving the principal point by whole pixels moves depth and labels by as many."""
    camera = small_settings.camera.intrinsics
    scene = forests[0][0]
    shifted = dataclasses.replace(camera, cx=camera.cx + 24, cy=camera.cy - 10)
    middle, aside = (renderer.draw(standing(scene, c)) for c in (camera, shifted))
    assert (middle.object_id[10:, :-24] == aside.object_id[:-10, 24:]).mean() > 0.9995
    gap = np.abs(middle.depth_m[10:, :-24] - aside.depth_m[:-10, 24:])
    assert (gap < 1e-3).mean() > 0.999


def test_sizes_that_cannot_be_are_refused_with_the_value_and_what_was_expected():
    with pytest.raises(SettingsError, match=r"width is 33.*expected an even number"):
        ideal_camera(33, 180)
    with pytest.raises(SettingsError, match=r"stems_per_ha is \(900, 300\): expected low <= high"):
        StandSettings(stems_per_ha=(900, 300))
