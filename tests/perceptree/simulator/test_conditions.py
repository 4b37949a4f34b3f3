"""Weather, light and scene content follow the settings."""

import dataclasses

import numpy as np
import pytest

from basetree.errors import SettingsError
from perceptree.simulator.scene.conditions import make_light, make_weather
from perceptree.simulator.scene.description import describe_scene
from perceptree.simulator.settings import (
    TIMES,
    WEATHERS,
    CameraSettings,
    LabelSettings,
    LightSettings,
    PoseSettings,
    SimulatorSettings,
    StandSettings,
    TerrainSettings,
    WeatherSettings,
    ideal_camera,
)


def weather(kind: str, strength: float, seed: int = 1):
    settings = WeatherSettings({kind: 1.0}, (strength, strength))
    return make_weather(np.random.default_rng(seed), settings)


def light(time: str, kind: str = "clear", overcast: float = 0.0, seed: int = 1):
    settings = LightSettings({time: 1.0}, overcast)
    return make_light(np.random.default_rng(seed), settings, weather(kind, 0.8))


def test_every_weather_does_what_its_name_says():
    assert weather("clear", 1.0).strength == 0
    assert weather("snow", 0.7).snow == 0.7
    assert weather("snow", 0.7).snowfall == 0
    assert weather("wet", 0.6).wet == 0.6
    assert weather("rain", 0.5).rain == 0.5
    assert weather("rain", 0.5).wet >= 0.5
    assert weather("snowfall", 0.9).snowfall == 0.9
    assert 0 < weather("snowfall", 0.9).snow <= 0.9
    assert weather("fog", 1.0).haze_per_m > 5 * weather("clear", 1.0).haze_per_m
    assert weather("fog", 1.0).haze_per_m > weather("fog", 0.3).haze_per_m


def test_the_sun_stands_and_shines_by_the_time_of_day():
    heights = {time: [light(time, seed=s).sun[2] for s in range(20)] for time in TIMES}
    assert min(heights["daylight"]) > max(heights["morning"]) > 0
    assert max(heights["dusk"]) < np.sin(np.radians(9))
    red = {time: np.divide(*light(time).sun_colour[[0, 2]]) for time in TIMES}
    assert red["evening"] > red["morning"] > red["daylight"]
    assert light("dusk").darkness > light("evening").darkness > light("daylight").darkness == 0
    assert light("dusk").sun_colour.max() < 0.2 * light("daylight").sun_colour.max()


def test_a_cooler_sun_is_as_bright_and_nearer_to_white():
    warm, cool = (
        make_light(
            np.random.default_rng(1),
            LightSettings({"evening": 1.0}, 0.0, sun_warmth=warmth),
            weather("clear", 0.8),
        )
        for warmth in (1.0, 0.5)
    )
    assert cool.sun_colour.sum() == pytest.approx(warm.sun_colour.sum())
    assert np.ptp(cool.sun_colour) == pytest.approx(0.5 * np.ptp(warm.sun_colour))
    assert np.array_equal(cool.sky_colour, warm.sky_colour)


def test_clouds_and_what_falls_take_the_sun():
    clear = light("daylight").sun_colour.max()
    assert light("daylight", overcast=1.0).overcast
    assert light("daylight", overcast=1.0).sun_colour.max() < 0.2 * clear
    assert light("daylight", "rain").sun_colour.max() < 0.2 * clear
    assert light("daylight", "fog").sun_colour.max() < 0.5 * clear


def test_weights_decide_how_often_a_weather_comes():
    rng = np.random.default_rng(4)
    settings = WeatherSettings({"clear": 3.0, "rain": 1.0})
    kinds = [make_weather(rng, settings).kind for _ in range(400)]
    assert set(kinds) == {"clear", "rain"}
    assert 0.68 < kinds.count("clear") / 400 < 0.82


def test_one_seed_is_one_scene_and_another_seed_another():
    settings = SimulatorSettings()
    first, again, other = (describe_scene(settings, seed) for seed in (7, 7, 8))
    assert [t.position_m.tolist() for t in first.trees] == [
        t.position_m.tolist() for t in again.trees
    ]
    assert (first.terrain.z_m == again.terrain.z_m).all()
    assert first.weather == again.weather
    assert (first.terrain.z_m != other.terrain.z_m).any()


def test_a_stand_has_its_species_diameters_and_leans():
    stand = StandSettings(species={"pine": 1.0, "birch": 1.0}, lean_std_deg=(15.0, 15.0))
    trees = []
    for seed in range(6):
        trees += describe_scene(SimulatorSettings(stand=stand), seed).trees
    diameters = np.array([tree.stem.diameter_m for tree in trees])
    assert {tree.stem.species for tree in trees} == {"pine", "birch"}
    assert len({tree.stem.model.name for tree in trees}) == 6
    assert 0.05 <= diameters.min() < 0.10
    assert 0.45 < diameters.max() <= 0.60
    assert 0.15 < np.median(diameters) < 0.30
    assert not ((diameters == 0.05) | (diameters == 0.60)).any()
    leans = np.degrees(np.arctan([np.hypot(*tree.stem.lean) for tree in trees]))
    assert 19 < leans.max() < 20.01


def test_snow_bares_the_broadleaves_and_labels_stand_above_the_uphill_side():
    steep = TerrainSettings(slope_deg=(25.0, 25.0))
    settings = SimulatorSettings(
        terrain=steep,
        weather=WeatherSettings({"snow": 1.0}, (0.8, 0.8)),
        labels=LabelSettings(cut_height_m=0.25, diameter_height_m=0.4),
    )
    scene = describe_scene(settings, 3)
    assert not scene.leaves
    for tree in scene.near_trees[:20]:
        angle = np.linspace(0, 2 * np.pi, 90)
        radius = 0.6 * tree.stem.diameter_m
        x, y, z = tree.position_m
        around = scene.terrain.height_m(x + radius * np.cos(angle), y + radius * np.sin(angle))
        assert tree.point(tree.cut_z_m)[2] - around.max() == pytest.approx(0.25, abs=0.01)
        assert z == pytest.approx(float(scene.terrain.height_m(x, y)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ideal_camera(33, 64), r"camera width is 33: expected an even number >= 64"),
        (lambda: ideal_camera(640, 360, 150.0), r"horizontal_fov_deg is 150: expected 20 to 130"),
        (
            lambda: StandSettings(stems_per_ha=(900, 300)),
            r"stems_per_ha is \(900, 300\): expected low <= high, both in \[10, 5000\]",
        ),
        (lambda: TerrainSettings(slope_deg=(0, 40)), r"slope_deg is \(0, 40\).*\[0, 30\]"),
        (
            lambda: TerrainSettings(grounds={"sand": 1.0}),
            r"grounds has the name 'sand': expected one of litter, moss, roots, mud",
        ),
        (
            lambda: WeatherSettings({"fog": -1.0}),
            r"weather kinds\['fog'\] is -1: expected a weight of at least 0",
        ),
        (lambda: WeatherSettings({"fog": 0.0}), r"weather kinds has no weight above 0"),
        (lambda: StandSettings(lean_max_deg=25.0), r"lean_max_deg is 25: expected 0 to 20"),
        (lambda: LabelSettings(reach_m=float("nan")), r"reach_m is nan: expected 1 to 13"),
        (
            lambda: LabelSettings(cut_height_m=0.5),
            r"cut_height_m, diameter_height_m and stem_height_m are 0.5, 0.3 and 4.0: expected",
        ),
        (lambda: PoseSettings((9.0, 12.0), (0, 0), (0, 0)), r"height_m is \(9, 12\)"),
        (lambda: CameraSettings(mast_share=2.0), r"mast_share is 2: expected 0 to 1"),
        (lambda: SimulatorSettings(views_per_scene=0), r"views_per_scene is 0: expected 1 to"),
    ],
)
def test_settings_out_of_range_name_the_setting_and_its_bounds(make, message: str):
    with pytest.raises(SettingsError, match=message):
        make()


@pytest.mark.slow
def test_every_weather_and_light_is_reached_by_the_default_mix():
    scenes = [describe_scene(SimulatorSettings(), seed) for seed in range(60)]
    assert {scene.weather.kind for scene in scenes} == set(WEATHERS)
    assert {scene.light.time for scene in scenes} == set(TIMES) - {"night"}
    assert {scene.pattern for scene in scenes} == {"random", "regular", "clustered"}


def test_a_scene_without_undergrowth_or_reach_is_still_a_scene():
    bare = dataclasses.replace(SimulatorSettings(), stand=StandSettings(stems_per_ha=(10.0, 10.0)))
    assert len(describe_scene(bare, 2).trees) == 7
