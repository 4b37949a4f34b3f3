"""What a label says is what the geometry is: held against formulas that the simulator lacks."""

import dataclasses

import numba
import numpy as np
import pytest

import calib
from perceptree.errors import SettingsError
from perceptree.simulator import CameraSettings, SimulatorSettings, StandSettings
from perceptree.simulator.camera import look_from, visible_faces
from perceptree.simulator.labels import label_view
from perceptree.simulator.render import Renderer
from perceptree.simulator.scene import Scene, build_scene, make_prototypes
from perceptree.simulator.terrain import Terrain, make_terrain
from perceptree.simulator.textures import make_textures
from perceptree.simulator.trees import Stem

SETTINGS = SimulatorSettings(
    camera=CameraSettings(width=320, height=180), stand=StandSettings(stems_per_ha=(500, 500))
)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(SETTINGS, make_prototypes(), 4)


@pytest.fixture(scope="module")
def renderer(scene: Scene) -> Renderer:
    return Renderer(make_textures(), scene)


def facing(scene: Scene, tree_index: int, distance_m: float):
    """A level view from the downhill side of one tree, straight at its foot's bearing."""
    tree = scene.trees[tree_index]
    origin = tree.position_m + np.array([-distance_m, 0.0, 1.8])
    return look_from(SETTINGS.camera, origin, 0.0, 0.0, 0.0)


def round_stem(diameter_m: float = 0.3) -> Stem:
    return Stem(
        "fir", diameter_m, 18.0, np.zeros(2), np.zeros(2), np.zeros(2), 0.0, 4, np.zeros((0, 4))
    )


def test_tape_diameter_of_a_round_stem_is_twice_its_radius():
    stem = round_stem()
    radius_m = stem.radius_m(np.array([1.3]), np.zeros(1))[0, 0]
    assert stem.girth_diameter_m(1.3) == pytest.approx(2 * radius_m, rel=1e-3)
    assert 2 * radius_m == pytest.approx(0.3)


def test_diameter_keypoints_are_tangent_rays_of_the_true_diameter(scene: Scene):
    """On a round, upright stem D = 2 d sin(a), a half the angle between the edges' rays."""
    tree = dataclasses.replace(scene.trees[0], stem=round_stem(0.4))
    lone = dataclasses.replace(scene, trees=[tree])
    view = facing(lone, 0, 3.0)
    drawing_of_all = np.ones((180, 320), np.int32)
    drawing = Renderer(make_textures(), scene).draw(view)
    label = label_view(
        view, dataclasses.replace(drawing, object_id=drawing_of_all), [tree], SETTINGS.labels
    )[0]
    rays = calib.pixels_to_rays(view.intrinsics, label.keypoints[1:3, :2])
    section = tree.point(tree.diameter_z_m)
    level = rays * [1, 0, 1]  # the section's plane is level, and so is the view
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    half = np.arccos(level[0] @ level[1]) / 2
    distance = np.hypot(*(section - view.origin)[:2])
    assert 2 * distance * np.sin(half) == pytest.approx(label.diameter_m, rel=2e-3)
    assert label.keypoints[1, 0] < label.keypoints[2, 0]


def test_labels_agree_with_the_depth_they_were_drawn_with(scene: Scene, renderer: Renderer):
    checked = 0
    for index in range(0, len(scene.trees), 6):
        view = facing(scene, index, 4.0)
        drawing = renderer.draw(view)
        for label in label_view(view, drawing, scene.trees, SETTINGS.labels):
            x, y, flag = label.keypoints[0]
            assert label.mask.any()
            assert label.distance_m <= SETTINGS.labels.reach_m
            x0, y0, x1, y1 = label.box_px
            assert label.mask[int(y0) : int(y1), int(x0) : int(x1)].sum() == label.mask.sum()
            if flag == 2 and label.mask[int(y), int(x)]:
                point = calib.pixels_to_points(
                    view.intrinsics, label.keypoints[:1, :2], drawing.depth_m[int(y), int(x)][None]
                )[0]
                gap = label.distance_m - np.linalg.norm(point)
                assert 0.2 * label.diameter_m < gap < 0.8 * label.diameter_m
                checked += 1
    assert checked >= 5


def test_pictures_do_not_depend_on_the_number_of_threads(scene: Scene, renderer: Renderer):
    view = facing(scene, 3, 5.0)
    before = numba.get_num_threads()
    drawings = []
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            drawings.append(renderer.draw(view))
    finally:
        numba.set_num_threads(before)
    for field in ("samples", "depth_m", "object_id"):
        first, second = (getattr(drawing, field) for drawing in drawings)
        assert np.array_equal(first, second), field


def test_culling_leaves_out_no_face_that_the_view_shows(
    scene: Scene, renderer: Renderer, monkeypatch
):
    eye = np.array([0.0, 0.0, scene.terrain.height_m(0.0, 0.0) + 1.8])
    view = look_from(SETTINGS.camera, eye, 0.5, 0.0, 0.0)
    culled = renderer.draw(view)
    assert len(visible_faces(scene, view)) < 0.7 * len(scene.faces)
    every = np.arange(len(scene.faces))
    monkeypatch.setattr("perceptree.simulator.render.visible_faces", lambda *_: every)
    assert np.array_equal(renderer.draw(view).depth_m, culled.depth_m)


def test_ground_height_lies_on_the_grounds_triangles():
    terrain: Terrain = make_terrain(np.random.default_rng(1), StandSettings())
    mesh = terrain.mesh()
    rng = np.random.default_rng(2)
    faces = mesh.faces[rng.integers(len(mesh.faces), size=500)]
    weights = rng.dirichlet(np.ones(3), 500)
    points = (mesh.vertices[faces] * weights[..., None]).sum(1)
    assert terrain.height_m(points[:, 0], points[:, 1]) == pytest.approx(points[:, 2], abs=1e-9)


def test_sizes_that_cannot_be_are_refused_with_the_value_and_what_was_expected():
    with pytest.raises(SettingsError, match=r"width is 33.*expected an even number"):
        CameraSettings(width=33)
    with pytest.raises(SettingsError, match=r"stems_per_ha is \(900, 300\): expected low <= high"):
        StandSettings(stems_per_ha=(900, 300))
