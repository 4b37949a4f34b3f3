"""Additions of the preset "field": clutter, objects, far forest, lamps, unnatural colours."""

import dataclasses
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from perceptree.simulator.dataset.frames import Assets, simulate_frames
from perceptree.simulator.geometry.assemble import assemble
from perceptree.simulator.geometry.objects import OBJECTS
from perceptree.simulator.materials.layers import CROWN_FOLIAGE, Layer
from perceptree.simulator.rendering.render import Renderer
from perceptree.simulator.rendering.view import random_view
from perceptree.simulator.scene.appearance import natural_appearance, random_appearance
from perceptree.simulator.scene.description import describe_scene
from perceptree.simulator.scene.objects import OBJECT_KINDS
from perceptree.simulator.settings import CameraSettings, RandomisationSettings
from perceptree.simulator.settings.presets import PRESETS


@pytest.fixture(scope="module")
def assets(textures, prototypes) -> Assets:
    return Assets(textures, prototypes)


@pytest.mark.parametrize("name", ["paper", "plain", "field-test"])
def test_older_presets_draw_the_same_frames(
    assets: Assets, check_golden_picture: Callable[[str, np.ndarray], None], name: str
):
    """Within a tolerance: processors differ in the last digit of a sum."""
    small = CameraSettings.of_size(160, 90)
    settings = dataclasses.replace(PRESETS[name].settings, camera=small)
    [frame] = simulate_frames(settings, 1_000_003, 1, assets)
    check_golden_picture(f"{name}_frame.png", frame.image)
    assert not {"near_person", "infrared_night", "caption"} & set(frame.realism)
    assert (frame.realism == {}) == (name != "field-test")


def test_objects_stand_clear_of_stems_and_cameras_clear_of_objects(field_settings, field_forest):
    scene = field_forest[0]
    counts = {p.kind: len(p.scale) for p in scene.undergrowth if p.kind in OBJECT_KINDS}
    assert counts == {
        "person": 3,
        "animal": 3,
        "machine": 1,
        "post": 4,
        "timber": 3,
        "wall": 2,
        "shape": 3,
    }
    feet = np.array([tree.position_m[:2] for tree in scene.trees])
    for x, y, radius in scene.obstacles:
        assert np.hypot(*(feet - [x, y]).T).min() > radius
    for number in range(50):
        rng = np.random.default_rng([scene.seed, 2, number])
        view = random_view(rng, field_settings.camera, scene)
        gaps_m = np.hypot(*(scene.obstacles[:, :2] - view.origin[:2]).T) - scene.obstacles[:, 2]
        assert gaps_m.min() > 0.8


@pytest.mark.parametrize(
    ("kind", "lowest_m", "highest_m"),
    [("person", 1.2, 2.1), ("animal", 0.35, 2.3), ("machine", 2.5, 7.5), ("post", 0.8, 9.1)],
)
def test_objects_have_their_size_and_stand_on_the_ground(kind, lowest_m, highest_m):
    make, _ = OBJECTS[kind]
    for seed in range(12):
        mesh = make(np.random.default_rng(seed))
        assert lowest_m < mesh.vertices[:, 2].max() < highest_m
        assert -0.35 < mesh.vertices[:, 2].min() < 0.1
        assert not mesh.labelled.any()
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-3)
        assert mesh.faces.max() < len(mesh.vertices)


def test_nothing_that_stands_upright_wears_bark_but_a_tree():
    make, _ = OBJECTS["shape"]
    barks = range(Layer.FIR_GREY, Layer.MAPLE_MOSSY + 1)
    for seed in range(200):
        mesh = make(np.random.default_rng(seed))
        bark = np.isin(mesh.layer, list(barks))
        if bark.any():
            points = np.unique(mesh.vertices[mesh.faces[bark]].reshape(-1, 3), axis=0)
            spread = np.linalg.svd(points - points.mean(0), full_matrices=False)[2][0]
            assert abs(spread[2]) < 0.9


def drawing_of(scene, mesh, textures, settings, number: int = 0):
    rng = np.random.default_rng([scene.seed, 2, number])
    return Renderer(textures, scene, mesh).draw(random_view(rng, settings.camera, scene))


def picture(drawing) -> np.ndarray:
    return drawing.samples[::2, ::2]


def test_the_far_forest_changes_the_background_alone(small_settings, forests, textures):
    scene, mesh = forests[0]
    far = drawing_of(dataclasses.replace(scene, backdrop=1.0), mesh, textures, small_settings)
    plain = drawing_of(scene, mesh, textures, small_settings)
    assert np.array_equal(far.depth_m, plain.depth_m)
    solid = cv2.erode((far.depth_m > 0).astype(np.uint8), np.ones((5, 5))) > 0
    open_ = cv2.erode((far.depth_m == 0).astype(np.uint8), np.ones((3, 3))) > 0
    assert open_.sum() > 100
    assert np.array_equal(picture(far)[solid], picture(plain)[solid])
    assert (picture(far) != picture(plain)).any(-1)[open_].mean() > 0.5


def test_a_lamp_lights_what_is_near_and_leaves_the_rest_black(
    field_settings, field_forest, textures
):
    scene, mesh = field_forest
    dark = dataclasses.replace(
        scene.light,
        lamp=20.0,
        sun_colour=np.zeros(3),
        sky_colour=np.full(3, 0.005),
        haze_colour=np.full(3, 0.001),
    )
    drawing = drawing_of(dataclasses.replace(scene, light=dark), mesh, textures, field_settings)
    light = picture(drawing).mean(-1)
    near = light[(drawing.depth_m > 0) & (drawing.depth_m < 5)]
    far = light[(drawing.depth_m > 20) | (drawing.depth_m == 0)]
    assert len(near) > 500
    assert len(far) > 500
    assert np.median(near) > 10 * np.median(far)


def test_a_recoloured_material_changes_where_it_is_seen_and_nowhere_else(
    field_settings, field_forest, textures
):
    scene, mesh = field_forest
    gains = np.ones((len(Layer), 3))
    gains[Layer.LITTER : Layer.MUD + 1] = (4.0, 0.2, 0.2)
    natural = dataclasses.replace(scene, appearance=natural_appearance())
    red = dataclasses.replace(
        scene, appearance=dataclasses.replace(natural_appearance(), gains=gains)
    )
    before, after = (
        picture(drawing_of(one, mesh, textures, field_settings)) for one in (natural, red)
    )
    changed = (before != after).any(-1)
    assert 0.05 < changed.mean() < 0.95
    assert (after[changed][:, 0] > after[changed][:, 1]).mean() > 0.9


def test_colours_change_as_often_as_asked_for_and_not_at_all_by_default():
    assert not random_appearance(np.random.default_rng(1), RandomisationSettings()).changed
    settings = RandomisationSettings(recolour=0.3, swap=0.1)
    looks = [random_appearance(np.random.default_rng(seed), settings) for seed in range(100)]
    recoloured = np.mean([(look.gains != 1).any(1) for look in looks])
    assert recoloured == pytest.approx(0.3, abs=0.03)
    texture_layer = np.mean([look.texture_layer != np.arange(len(Layer)) for look in looks])
    assert texture_layer == pytest.approx(0.1, abs=0.02)


def test_dead_twigs_and_low_plants_come_with_their_settings(field_settings, prototypes):
    scene = describe_scene(field_settings, 21)
    bare = dataclasses.replace(scene, dead_twigs=0.0)
    conifers = sum(tree.stem.model.conifer for tree in scene.near_trees)
    thick = dataclasses.replace(scene, dead_twigs=3.0)
    more = len(assemble(thick, prototypes).faces) - len(assemble(bare, prototypes).faces)
    assert conifers > 0
    assert more > 500 * conifers


def test_a_share_of_the_trees_is_dead_and_some_are_broken_above_their_labels(
    field_settings, field_forest, prototypes
):
    stand = dataclasses.replace(field_settings.stand, dead_share=0.4)
    scene = describe_scene(dataclasses.replace(field_settings, stand=stand), 21)
    alive = dataclasses.replace(scene, trees=[_alive(tree) for tree in scene.trees])
    dead = [tree for tree in scene.trees if tree.dead]
    assert len(dead) / len(scene.trees) == pytest.approx(0.4, abs=0.1)
    broken = [tree for tree in dead if tree.stem.broken_m is not None]
    assert 0.1 < len(broken) / len(dead) < 0.6
    for tree in broken:
        assert tree.top_z_m < tree.stem.broken_m < 0.9 * tree.stem.height_m
    assert all(tree.stem.broken_m is None for tree in scene.trees if not tree.dead)
    foliage = [np.isin(assemble(s, prototypes).layer, CROWN_FOLIAGE).sum() for s in (scene, alive)]
    assert foliage[0] < 0.9 * foliage[1]
    standing = [tree.position_m.tolist() for tree in field_forest[0].trees]
    assert [tree.position_m.tolist() for tree in scene.trees] == standing


def _alive(tree):
    return dataclasses.replace(tree, dead=False, stem=dataclasses.replace(tree.stem, broken_m=None))


def test_a_frame_says_what_it_holds_beyond_the_papers_conditions(field_settings, assets: Assets):
    [frame] = simulate_frames(field_settings, 21, 1, assets)
    assert frame.realism["person"] == 3
    assert {"dead_twigs", "backdrop", "camera_faults", "infrared", "recoloured"} <= set(
        frame.realism
    )
    assert {"infrared_night", "caption", "near_person", "near_log"} <= set(frame.realism)
