"""What is mistaken for stems near the cameras: legs, posts, dead wood, stumps, twigs, thickets."""

import dataclasses

import numpy as np
import pytest

from basetree.errors import SettingsError
from perceptree.simulator.dataset.frames import Assets, simulate_frames
from perceptree.simulator.geometry.negatives import LOG_M, NEGATIVES
from perceptree.simulator.labelling.frame import LabelledFrame
from perceptree.simulator.materials.layers import LAST_BARK
from perceptree.simulator.rendering.foreground import with_foreground
from perceptree.simulator.rendering.view import View, random_view
from perceptree.simulator.scene.description import Scene, describe_scene
from perceptree.simulator.scene.scatter import Placement
from perceptree.simulator.settings import DriveSettings, NegativeSettings, TrapSettings
from perceptree.simulator.streams import Stream, stream

MANY = NegativeSettings(
    people=(2, 2),
    animals=(2, 2),
    posts=(2, 2),
    logs=(2, 2),
    stumps=(2, 2),
    twigs=(1, 1),
    thickets=(3, 3),
)
UPRIGHT = ("near_person", "near_animal", "near_post")


@pytest.fixture(scope="module")
def assets(textures, prototypes) -> Assets:
    return Assets(textures, prototypes)


@pytest.fixture(scope="module")
def settings(field_settings):
    """The preset "field" by its own light, without what is near."""
    return dataclasses.replace(
        field_settings, negatives=NegativeSettings(), trap=TrapSettings(), views_per_scene=2
    )


@pytest.fixture(scope="module")
def crowded(settings):
    return dataclasses.replace(settings, negatives=MANY)


@pytest.fixture(scope="module")
def crowded_frames(crowded, assets: Assets) -> list[LabelledFrame]:
    return list(simulate_frames(crowded, 21, 2, assets))


def placed_in(scene: Scene, crowded) -> list[Placement]:
    return with_foreground(crowded, scene).undergrowth[len(scene.undergrowth) :]


def views_of(scene: Scene, crowded) -> list[View]:
    numbers = range(crowded.views_per_scene)
    return [random_view(stream(scene.seed, Stream.VIEW, n), crowded.camera, scene) for n in numbers]


def test_no_label_moves_and_stems_are_only_hidden(settings, crowded_frames, assets: Assets):
    hidden_stems = 0
    for free, full in zip(simulate_frames(settings, 21, 2, assets), crowded_frames, strict=True):
        assert np.array_equal(free.view.origin, full.view.origin)
        assert np.array_equal(free.view.rotation, full.view.rotation)
        assert free.scene == full.scene
        before = {label.stem: label for label in free.labels}
        assert {label.stem for label in full.labels} <= set(before)
        for label in full.labels:
            known = before[label.stem]
            assert label.diameter_m == known.diameter_m
            assert np.array_equal(label.keypoints[:, :2], known.keypoints[:, :2])
            assert not (label.mask & ~known.mask).any()
        hidden_stems += sum(label.visible_fraction for label in free.labels) > sum(
            label.visible_fraction for label in full.labels
        )
        nearer = (full.exact_depth_m > 0) & (full.exact_depth_m < free.exact_depth_m - 0.05)
        assert nearer.mean() > 0.02
    assert hidden_stems > 0


def test_a_frame_says_what_stands_near_and_is_the_same_however_many_are_drawn(
    crowded, crowded_frames, assets: Assets
):
    [alone] = simulate_frames(crowded, 21, 1, assets)
    first = crowded_frames[0]
    assert np.array_equal(alone.image, first.image)
    assert alone.realism == first.realism
    assert alone.realism["lens_twig"] == 2
    assert 2 <= alone.realism["near_post"] <= 4


def test_objects_stand_before_the_cameras_and_clear_of_stems_and_cameras(crowded):
    scene = describe_scene(crowded, 21)
    views = views_of(scene, crowded)
    stems = [[*tree.position_m[:2], tree.stem.diameter_m / 2] for tree in scene.near_trees]
    feet_m, radii_m = np.array(stems)[:, :2], np.array(stems)[:, 2]
    seen = 0
    near = [one for one in placed_in(scene, crowded) if one.kind.startswith("near_")]
    assert len(near) >= 10
    for placement in near:
        [place] = placement.position_m
        assert place[2] == pytest.approx(float(scene.terrain.height_m(*place[:2])))
        assert (np.hypot(*(feet_m - place[:2]).T) - radii_m).min() > 0.4
        away_m = [float(np.hypot(*(place - view.origin)[:2])) for view in views]
        assert min(away_m) > 0.65
        assert min(away_m) < 9.5
        rays = [view.to_camera(np.add(place, [0, 0, 0.3])) for view in views]
        seen += any(
            z > 0 and view.ray_bounds[0] < x / z < view.ray_bounds[1]
            for view, (x, _, z) in zip(views, rays, strict=True)
        )
    assert seen == len(near)


def test_a_long_log_goes_through_no_stem(crowded):
    logs = dataclasses.replace(crowded, negatives=NegativeSettings(logs=(6, 6)))
    for seed in (21, 22, 23):
        scene = describe_scene(crowded, seed)
        stems = [[*tree.position_m[:2], tree.stem.diameter_m / 2] for tree in scene.near_trees]
        for log in placed_in(scene, logs):
            along = np.linspace(-0.5, 0.5, 41)[:, None] * LOG_M * log.scale
            axis_m = log.position_m[0, :2] + along * log.rotation[0, :2, 0]
            gaps_m = np.linalg.norm(axis_m[:, None] - np.array(stems)[:, :2], axis=-1)
            assert (gaps_m - np.array(stems)[:, 2]).min() > 0.05


def test_drives_and_scenes_without_negatives_stay_as_they_are(settings, crowded, field_forest):
    scene, _ = field_forest
    assert with_foreground(settings, scene) is scene
    drive = dataclasses.replace(crowded, drive=DriveSettings(rate_hz=10.0))
    moving = describe_scene(drive, 21)
    assert moving.circuit is not None
    assert with_foreground(drive, moving) is moving


def test_a_thicket_is_a_row_of_bushes_that_keeps_clear_of_stems(crowded):
    rows = dataclasses.replace(crowded, negatives=NegativeSettings(thickets=(4, 4)))
    scene = describe_scene(crowded, 21)
    bushes = placed_in(scene, rows)
    assert len(bushes) > 8
    assert {bush.kind for bush in bushes} <= {"sapling", "hedge_shrub", "beech_hedge_shrub"}
    feet_m = np.array([tree.position_m[:2] for tree in scene.near_trees])
    for bush in bushes:
        assert np.hypot(*(feet_m - bush.position_m[0, :2]).T).min() > 0.5


@pytest.mark.parametrize("kind", NEGATIVES)
def test_meshes_are_sound_and_without_labels(kind: str):
    make, _ = NEGATIVES[kind]
    for seed in range(20):
        mesh = make(np.random.default_rng(seed))
        assert np.isfinite(mesh.vertices).all()
        assert mesh.faces.max() < len(mesh.vertices)
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-3)
        assert not mesh.labelled.any()
        if kind != "lens_twig":
            assert -1.6 < mesh.vertices[:, 2].min() < 0.15


@pytest.mark.parametrize("kind", NEGATIVES)
def test_only_what_lies_and_stumps_wear_bark(kind: str):
    make, _ = NEGATIVES[kind]
    for seed in range(60):
        mesh = make(np.random.default_rng(seed))
        bark = mesh.layer <= LAST_BARK
        if kind in UPRIGHT or kind == "lens_twig":
            assert not bark.any()
        elif bark.any():
            assert mesh.vertices[mesh.faces[bark]][..., 2].max() < 1.0


def test_what_stands_has_the_size_of_its_kind():
    limits_m = {
        "near_person": (1.4, 2.1),
        "near_animal": (0.3, 2.9),
        "near_post": (0.45, 3.1),
        "near_stump": (0.1, 0.95),
    }
    for kind, (low, high) in limits_m.items():
        meshes = [NEGATIVES[kind][0](np.random.default_rng(seed)) for seed in range(40)]
        tops = [mesh.vertices[:, 2].max() for mesh in meshes]
        assert low < min(tops)
        assert max(tops) < high


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"people": (-1.0, 2.0)}, r"people is \(-1, 2\): expected low <= high"),
        ({"thickets": (3.0, 2.0)}, r"thickets is \(3, 2\): expected low <= high"),
    ],
)
def test_a_wrong_setting_is_named(values, message: str):
    with pytest.raises(SettingsError, match=message):
        NegativeSettings(**values)
