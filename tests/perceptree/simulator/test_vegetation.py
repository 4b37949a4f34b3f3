"""Dense grass, hedges and deep snow: they hide what they promise, and no label moves."""

import dataclasses

import numpy as np
import pytest

import calib
from basetree.errors import SettingsError
from perceptree.simulator.dataset.frames import Assets, simulate_frames
from perceptree.simulator.geometry.assemble import assemble
from perceptree.simulator.geometry.vegetation import VEGETATION
from perceptree.simulator.materials.layers import Layer
from perceptree.simulator.rendering.render import Renderer
from perceptree.simulator.rendering.view import View, random_view
from perceptree.simulator.scene.conditions import Weather
from perceptree.simulator.scene.description import Scene, describe_scene
from perceptree.simulator.scene.terrain import Terrain
from perceptree.simulator.scene.vegetation import Vegetation, grow_vegetation
from perceptree.simulator.settings import (
    SimulatorSettings,
    UndergrowthSettings,
    VegetationSettings,
    WeatherSettings,
)
from perceptree.simulator.settings.presets import PRESETS
from perceptree.simulator.streams import Stream, stream

SEED = 4
CLEAR, SNOWY = (
    Weather(kind, 0.5, snow, 0.0, 0.0, 0.0, 0.001) for kind, snow in (("clear", 0.0), ("snow", 0.5))
)
NO_STEMS, NO_PATH = np.empty((0, 3)), np.empty((0, 2))
NEAR_M = 8.0


@pytest.fixture(scope="module")
def assets(textures, prototypes) -> Assets:
    return Assets(textures, prototypes)


@pytest.fixture(scope="module")
def terrain(forests) -> Terrain:
    return forests[0][0].terrain


def with_cover(settings: SimulatorSettings, **cover: object) -> SimulatorSettings:
    return dataclasses.replace(settings, vegetation=VegetationSettings(**cover))


def grown(terrain: Terrain, seed: int = SEED, weather: Weather = CLEAR, **cover) -> Vegetation:
    settings = VegetationSettings(**cover)
    return grow_vegetation(seed, settings, terrain, weather, NO_STEMS, NO_PATH)


def depths_m(scene: Scene, assets: Assets, views: list[View]) -> list[np.ndarray]:
    renderer = Renderer(assets.textures, scene, assemble(scene, assets.prototypes))
    return [renderer.draw(view).depth_m for view in views]


def world_points(view: View, depth_m: np.ndarray) -> np.ndarray:
    """(H, W, 3) world points of exact depths, m."""
    camera = view.intrinsics
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    rays = calib.pixels_to_rays(camera, np.stack([columns, rows], -1).reshape(-1, 2))
    rays = rays.reshape(*depth_m.shape, -1)[..., :2]
    local = np.concatenate([rays, np.ones_like(rays[..., :1])], -1) * depth_m[..., None]
    return local @ view.rotation + view.origin


def height_above_soil_m(scene: Scene, view: View, depth_m: np.ndarray) -> np.ndarray:
    points = world_points(view, depth_m)
    return points[..., 2] - scene.terrain.height_m(points[..., 0], points[..., 1])


@pytest.mark.parametrize(("cover", "height_m"), [(0.4, 0.2), (0.7, 0.3), (0.95, 0.4)])
def test_grass_hides_about_the_share_of_the_ground_that_is_asked_for(
    small_settings, assets: Assets, cover: float, height_m: float
):
    bare_ground = dataclasses.replace(
        small_settings,
        undergrowth=UndergrowthSettings(*[(0.0, 0.0)] * 6),
        stand=dataclasses.replace(small_settings.stand, stems_per_ha=(100.0, 100.0)),
    )
    settings = with_cover(
        bare_ground,
        grass_share=1.0,
        grass_cover=(cover, cover),
        grass_height_m=(height_m, height_m),
    )
    hidden = []
    for seed in (3, 6):
        grassy = describe_scene(settings, seed)
        bare = describe_scene(bare_ground, seed)
        views = [
            random_view(stream(seed, Stream.VIEW, number), settings.camera, bare)
            for number in range(3)
        ]
        pairs = zip(depths_m(bare, assets, views), depths_m(grassy, assets, views), strict=True)
        for view, (soil_m, seen_m) in zip(views, pairs, strict=True):
            low = np.abs(height_above_soil_m(bare, view, soil_m)) < 0.02
            ground = low & (soil_m > 0) & (soil_m < NEAR_M)
            hidden.append((seen_m < soil_m - 0.005)[ground])
            above_m = height_above_soil_m(grassy, view, seen_m)[ground]
            assert above_m.max() < 1.5 * height_m
    # Grass in front of a gap hides some of it, so the share seen is often above the one asked for.
    assert np.concatenate(hidden).mean() == pytest.approx(cover, abs=0.18)


def test_grass_grows_in_patches_of_the_share_asked_for_up_to_the_bark(terrain: Terrain):
    stems_m = np.array([[2.0, 1.0, 0.2]])
    settings = VegetationSettings(
        grass_share=1.0, grass_cover=(1.0, 1.0), grass_height_m=(0.3, 0.3)
    )
    scene = grow_vegetation(SEED, settings, terrain, CLEAR, stems_m, NO_PATH)
    positions = np.concatenate([p.position_m for p in scene.placements])
    gaps_m = np.hypot(*(positions[:, :2] - stems_m[0, :2]).T)
    assert 0.2 < gaps_m.min() < 0.3
    half = grown(
        terrain, grass_share=1.0, grass_cover=(0.5, 0.5), grass_height_m=(0.3, 0.3)
    ).placements
    assert sum(len(p.scale) for p in half) / len(positions) == pytest.approx(0.5, abs=0.08)
    tallest = [
        (p.scale.max(), p.scale.min()) for p in scene.placements if p.kind.startswith("green")
    ]
    assert max(high for high, _ in tallest) <= 1.25 * 0.3
    assert min(low for _, low in tallest) >= 0.75 * 0.3


@pytest.mark.slow
def test_no_label_moves_and_stems_are_only_hidden(field_settings, assets: Assets):
    covered = with_cover(
        field_settings,
        grass_share=1.0,
        grass_cover=(0.9, 0.9),
        grass_height_m=(0.4, 0.4),
        hedge_share=1.0,
    )
    less_visible = 0
    for open_, hidden in zip(
        simulate_frames(field_settings, 21, 3, assets),
        simulate_frames(covered, 21, 3, assets),
        strict=True,
    ):
        assert np.array_equal(open_.view.origin, hidden.view.origin)
        assert hidden.realism["grass_cover"] == 0.9
        assert hidden.realism["hedges"] >= 1
        before = {label.stem: label for label in open_.labels}
        assert {label.stem for label in hidden.labels} <= set(before)
        for label in hidden.labels:
            same_truth(label, before[label.stem])
            less_visible += label.visible_fraction < before[label.stem].visible_fraction
    assert less_visible > 0


def same_truth(hidden, open_) -> None:
    for name in (
        "cut_height_m",
        "diameter_m",
        "diameter_height_m",
        "diameter_breast_m",
        "distance_m",
        "inclination_deg",
    ):
        assert getattr(hidden, name) == getattr(open_, name)
    assert np.array_equal(hidden.position_camera_m, open_.position_camera_m)
    assert np.array_equal(hidden.keypoints[:, :2], open_.keypoints[:, :2])
    assert (hidden.keypoints[:, 2] <= open_.keypoints[:, 2]).all()
    assert hidden.visible_fraction <= open_.visible_fraction
    assert not (hidden.mask & ~open_.mask).any()


@pytest.mark.slow
def test_deep_snow_lies_on_the_soil_and_hides_the_foot_of_stems(small_settings, assets: Assets):
    thin = dataclasses.replace(
        small_settings,
        weather=WeatherSettings(kinds={"snow": 1.0}, strength=(1.0, 1.0)),
        undergrowth=UndergrowthSettings(*[(0.0, 0.0)] * 6),
    )
    deep = with_cover(thin, snow_depth_m=(0.3, 0.3), grass_share=1.0)
    scene = describe_scene(deep, SEED)
    assert scene.vegetation.snow_depth_m == 0.3
    assert scene.vegetation.grass_cover == 0
    view = random_view(stream(SEED, Stream.VIEW, 0), deep.camera, scene)
    [soil_m], [snow_m] = (
        depths_m(one, assets, [view]) for one in (describe_scene(thin, SEED), scene)
    )
    ground = (np.abs(height_above_soil_m(scene, view, soil_m)) < 0.02) & (soil_m > 0)
    above_m = height_above_soil_m(scene, view, snow_m)[ground & (soil_m < NEAR_M)]
    assert np.median(above_m) == pytest.approx(0.3, abs=0.08)
    assert np.percentile(above_m, 1) > 0.05
    for shallow, buried in zip(
        simulate_frames(thin, SEED, 3, assets), simulate_frames(deep, SEED, 3, assets), strict=True
    ):
        before = {label.stem: label for label in shallow.labels}
        for label in buried.labels:
            same_truth(label, before[label.stem])


def test_snow_has_a_depth_where_it_lies_only_and_leaves_no_grass(terrain: Terrain):
    cover = {"grass_share": 1.0, "snow_depth_m": (0.1, 0.4)}
    assert grown(terrain, weather=SNOWY, **cover).placements == []
    clear = grown(terrain, weather=CLEAR, **cover)
    assert clear.snow_m is None
    assert clear.placements


def test_hedges_pass_the_cameras_and_have_their_height(terrain: Terrain, prototypes):
    for seed in range(20):
        scene = grown(terrain, seed, hedge_share=1.0, hedges=(2.0, 2.0), hedge_height_m=(1.5, 1.5))
        assert scene.hedges == len(scene.placements) == 2
        for hedge in scene.placements:
            assert np.hypot(*hedge.position_m[:, :2].T).min() > 6.5
            tops = [mesh.vertices[:, 2].max() for mesh in prototypes.undergrowth[hedge.kind]]
            assert np.median(hedge.scale) * np.mean(tops) == pytest.approx(1.5, rel=0.2)


def test_what_is_drawn_of_one_kind_changes_no_other(terrain: Terrain):
    grass = {"grass_share": 1.0}
    alone, both = (grown(terrain, **grass, hedge_share=share) for share in (0.0, 1.0))
    assert both.hedges > 0
    for one, other in zip(alone.placements, both.placements[: len(alone.placements)], strict=True):
        assert np.array_equal(one.position_m, other.position_m)


def test_the_preset_holds_grass_hedges_and_deep_snow_in_their_shares(terrain: Terrain):
    preset = PRESETS["vegetation"].settings
    plain = dataclasses.replace(preset, vegetation=VegetationSettings())
    former = PRESETS["field-test"].settings
    assert plain == dataclasses.replace(former, splits=plain.splits, depth=plain.depth)
    few = dataclasses.replace(preset.vegetation, grass_cover=(0.01, 0.01))
    clear = [grow_vegetation(seed, few, terrain, CLEAR, NO_STEMS, NO_PATH) for seed in range(100)]
    assert np.mean([scene.grass_cover > 0 for scene in clear]) == pytest.approx(0.7, abs=0.12)
    assert np.mean([scene.hedges > 0 for scene in clear]) == pytest.approx(0.2, abs=0.1)
    assert all(scene.snow_depth_m == 0 for scene in clear)


def test_nothing_grows_by_default():
    assert PRESETS["field"].settings.vegetation == VegetationSettings()
    assert "vegetation" not in PRESETS["field"].settings.to_dict()
    scene = describe_scene(PRESETS["field"].settings, 3_000_003)
    assert scene.vegetation.placements == []
    assert scene.vegetation.snow_m is None


@pytest.mark.parametrize("name", VEGETATION)
def test_meshes_are_sound_without_labels_and_cut_out(prototypes, name: str):
    for mesh in prototypes.undergrowth[name]:
        assert len(mesh.faces) <= (320 if name.endswith("shrub") else 12)
        assert mesh.faces.max() < len(mesh.vertices)
        assert np.isfinite(mesh.vertices).all()
        assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0, abs=1e-4)
        assert not mesh.labelled.any()
        assert ((mesh.layer >= Layer.FIR_TWIG) & (mesh.layer < Layer.PAINT)).all()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"grass_share": 2.0}, "grass_share is 2: expected 0 to 1"),
        ({"grass_cover": (0.5, 1.5)}, r"grass_cover is \(0.5, 1.5\): expected low <= high"),
        ({"snow_depth_m": (0.1, 3.0)}, r"snow_depth_m is \(0.1, 3\)"),
    ],
)
def test_wrong_values_are_named(values: dict, message: str):
    with pytest.raises(SettingsError, match=message):
        VegetationSettings(**values)
