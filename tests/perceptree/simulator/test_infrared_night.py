"""Infrared nights and captions of camera traps: what changes in a picture, and what does not."""

import dataclasses

import cv2
import numpy as np
import pytest

from basetree.errors import SettingsError
from perceptree.simulator.dataset.frames import Assets, simulate_frames
from perceptree.simulator.rendering import shade_light
from perceptree.simulator.rendering.kernel_types import Atmosphere
from perceptree.simulator.rendering.render import Renderer
from perceptree.simulator.rendering.view import random_view
from perceptree.simulator.scene.conditions import infrared_light
from perceptree.simulator.scene.description import describe_scene
from perceptree.simulator.sensors.caption import draw_caption
from perceptree.simulator.sensors.infrared_night import (
    InfraredNight,
    draw_night,
    light_beam,
    metered_luminance,
    night_picture,
)
from perceptree.simulator.settings import (
    CameraSettings,
    SimulatorSettings,
    StandSettings,
    TrapSettings,
    UndergrowthSettings,
)

NIGHTS = TrapSettings(infrared_share=1.0, caption_share=1.0, tint_share=0.0)
STEADY = InfraredNight(3.0, 0.5, np.zeros(2), 0.0, 0.0, 0.0, 0.0, (1.0, 1.0, 1.0))


@pytest.fixture(scope="module")
def assets(textures, prototypes) -> Assets:
    return Assets(textures, prototypes)


@pytest.fixture(scope="module")
def pairs(field_settings, assets: Assets) -> list:
    """Two frames of a scene by its own light, and the same two as infrared nights."""
    return list(
        zip(
            *(
                simulate_frames(dataclasses.replace(field_settings, trap=trap), 21, 2, assets)
                for trap in (TrapSettings(), NIGHTS)
            ),
            strict=True,
        )
    )


def test_a_night_changes_the_picture_alone(pairs):
    for day, night in pairs:
        assert np.array_equal(day.view.origin, night.view.origin)
        assert np.array_equal(day.depth_m, night.depth_m)
        assert np.array_equal(day.exact_depth_m, night.exact_depth_m)
        assert len(day.labels) == len(night.labels)
        for one, other in zip(day.labels, night.labels, strict=True):
            assert one.visible_fraction == other.visible_fraction
            assert np.array_equal(one.mask, other.mask)
            assert np.array_equal(one.keypoints, other.keypoints)
        assert not np.array_equal(day.image, night.image)


def test_a_frame_says_that_it_is_an_infrared_night_with_a_caption(pairs):
    for day, night in pairs:
        assert not {"infrared_night", "caption"} & set(day.realism)
        assert night.realism["infrared_night"]
        assert night.realism["caption"]
        assert night.realism["infrared"]
        assert (night.scene.light, day.scene.light != "night") == ("night", True)


def test_without_a_caption_a_night_is_grey_above_its_floor(field_settings, assets: Assets):
    bare = dataclasses.replace(NIGHTS, caption_share=0.0, floor=(0.3, 0.3))
    [frame] = simulate_frames(dataclasses.replace(field_settings, trap=bare), 21, 1, assets)
    assert (np.ptp(frame.image, axis=-1) == 0).all()
    assert np.percentile(frame.image, 5) > 60
    assert not frame.realism["caption"]


def test_near_stems_are_bright_and_what_is_far_is_black(field_settings, field_forest, textures):
    scene, mesh = field_forest
    light = infrared_light(np.random.default_rng(2), scene.light, scene.weather)
    dark = dataclasses.replace(scene, light=light)
    renderer = Renderer(textures, dark, mesh)
    levels: dict[str, list] = {"near": [], "middle": [], "far": []}
    for number in range(3):
        rng = np.random.default_rng([scene.seed, 2, number])
        drawing = renderer.draw(random_view(rng, field_settings.camera, dark))
        shown = drawing.samples[::2, ::2, 1]
        depth_m = drawing.depth_m
        stem = drawing.object_id > 0
        levels["near"] += shown[stem & (depth_m < 2.5)].tolist()
        levels["middle"] += shown[stem & (depth_m > 4) & (depth_m < 6)].tolist()
        levels["far"] += shown[(depth_m > 14) | (depth_m == 0)].tolist()
    assert min(len(values) for values in levels.values()) > 200
    near, middle, far = (np.median(levels[name]) for name in ("near", "middle", "far"))
    assert near > 4 * middle
    assert middle > 8 * far


def atmosphere(infrared: float) -> Atmosphere:
    dark = np.zeros(3, np.float32)
    values = (dark, dark, dark, dark, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, infrared)
    return Atmosphere(*(np.float32(v) if isinstance(v, float) else v for v in values))


@pytest.mark.parametrize(("infrared", "gain"), [(0.0, 1.0), (1.0, 4.0)])
def test_the_lamps_light_falls_with_the_square_of_the_distance(infrared: float, gain: float):
    """Only the infrared lamp dazzles nearer than 1 m."""
    towards, away = np.array([0, -1, 0], np.float32), np.array([0, 1, 0], np.float32)
    light = [
        shade_light._lamp(towards, away, np.float32(1), np.float32(z), False, atmosphere(infrared))
        for z in (0.5, 1.0, 2.0, 4.0, 8.0)
    ]
    assert light == pytest.approx([gain, 1, 1 / 4, 1 / 16, 1 / 64])


def test_leaves_are_bright_in_infrared_and_black_fur_is_not_black():
    albedos = {"leaf": (0.06, 0.13, 0.03), "bark": (0.10, 0.09, 0.08), "black": (0.01, 0.01, 0.01)}
    shown = {}
    for name, albedo in albedos.items():
        colour = np.array(albedo, np.float32)
        shade_light._reflect_infrared(colour)
        assert colour[0] == colour[1] == colour[2]
        shown[name] = float(colour[0])
    assert shown["leaf"] > 1.4 * shown["bark"] > 1.4 * shown["black"]
    assert shown["black"] > 0.04
    white = np.ones(3, np.float32)
    shade_light._reflect_infrared(white)
    assert white.max() < 1


def test_half_of_the_exposure_follows_the_reach_and_half_the_picture():
    samples = np.full((40, 40, 3), 0.02, np.float32)
    level = metered_luminance(STEADY, samples)
    assert level == pytest.approx(0.5 * np.log(0.02) + 0.5 * np.log(0.3 / 9), rel=1e-5)
    farther = dataclasses.replace(STEADY, reach_m=6.0)
    assert level - metered_luminance(farther, samples) == pytest.approx(np.log(2))
    assert metered_luminance(STEADY, 4 * samples) - level == pytest.approx(np.log(2))
    assert np.isfinite(metered_luminance(STEADY, np.zeros_like(samples)))


def test_the_beam_is_bright_in_its_middle_and_half_as_wide_as_stated():
    samples = np.ones((90, 160, 3), np.float32)
    lit = light_beam(dataclasses.replace(STEADY, beam=0.25), samples)
    assert lit[45, 80].min() > 0.99
    assert lit[45, 0, 0] == pytest.approx(np.exp(-2), rel=0.05)  # half a width is two deviations
    assert (np.diff(lit[45, 80:, 0]) < 0).all()
    shifted = dataclasses.replace(STEADY, beam=0.25, beam_shift=np.array([0.25, 0.0]))
    assert light_beam(shifted, samples)[45, :, 1].argmax() in (119, 120)


def test_a_night_picture_has_its_grain_floor_and_tint_and_does_not_move():
    rng = np.random.default_rng(3)
    image = np.full((180, 320, 3), 60, np.uint8)
    image[20:150, 100:117] = 160
    plain = night_picture(rng, STEADY, image)
    assert np.array_equal(plain, image)
    grain = dataclasses.replace(STEADY, grain=0.03, grain_px=0.8)
    noise = night_picture(rng, grain, image).astype(float) - image
    assert noise.std() == pytest.approx(0.03 * 255, rel=0.1)
    assert abs(noise.mean()) < 0.5
    black = night_picture(rng, dataclasses.replace(STEADY, floor=0.1), np.zeros_like(image))
    assert set(black.ravel().tolist()) == {26}
    purple = night_picture(rng, dataclasses.replace(STEADY, tint=(1.1, 0.9, 1.05)), image)
    assert purple[0, 0].tolist() == [66, 54, 63]
    soft = night_picture(rng, dataclasses.replace(STEADY, blur_px=1.5), image)
    shift, _ = cv2.phaseCorrelate(*(i[..., 0].astype(float) for i in (image, soft)))
    assert np.hypot(*shift) < 0.3


def test_the_camera_of_a_night_is_within_its_settings():
    settings = TrapSettings(tint_share=0.3)
    nights = [draw_night(np.random.default_rng(seed), settings) for seed in range(400)]
    for name in ("reach_m", "beam", "blur_px", "grain", "floor"):
        low, high = getattr(settings, name)
        drawn = [getattr(night, name) for night in nights]
        assert low <= min(drawn) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(drawn) <= high
    tinted = np.mean([night.tint != (1.0, 1.0, 1.0) for night in nights])
    assert tinted == pytest.approx(0.3, abs=0.07)


def test_as_many_scenes_are_infrared_nights_as_asked_for():
    none = (0.0, 0.0)
    quick = SimulatorSettings(
        stand=StandSettings(stems_per_ha=(50.0, 50.0)),
        undergrowth=UndergrowthSettings(*[none] * 6),
        trap=TrapSettings(infrared_share=0.3),
    )
    lights = [describe_scene(quick, seed).light for seed in range(150)]
    assert np.mean([light.infrared for light in lights]) == pytest.approx(0.3, abs=0.1)
    assert all(light.time == "night" and light.lamp == 1 for light in lights if light.infrared)
    assert all(light.lamp == 0 for light in lights if not light.infrared)


def test_a_caption_covers_the_edges_alone_and_leaves_the_picture_before_it():
    image = np.random.default_rng(1).integers(0, 256, (360, 640, 3), np.uint8)
    kept, logos = image.copy(), 0
    for seed in range(60):
        marked = draw_caption(np.random.default_rng(seed), image)
        changed = (marked != image).any(-1)
        assert changed.any()
        assert not changed[int(0.15 * 360) : int(0.85 * 360)].any()
        logos += changed[int(0.85 * 360) : int(0.92 * 360)].any()
        assert np.array_equal(marked, draw_caption(np.random.default_rng(seed), image))
    assert np.array_equal(image, kept)
    assert 0 < logos < 40


@pytest.mark.parametrize("size", [(64, 64), (160, 90), (1280, 720)])
def test_a_caption_fits_any_picture(size: tuple[int, int]):
    width, height = size
    for seed in range(20):
        marked = draw_caption(np.random.default_rng(seed), np.zeros((height, width, 3), np.uint8))
        assert marked.shape == (height, width, 3)


def test_captions_come_in_the_share_asked_for(assets: Assets):
    settings = SimulatorSettings(
        camera=CameraSettings.of_size(64, 64),
        stand=StandSettings(stems_per_ha=(50.0, 50.0)),
        undergrowth=UndergrowthSettings(*[(0.0, 0.0)] * 6),
        trap=TrapSettings(caption_share=0.25),
    )
    frames = list(simulate_frames(settings, 5, 48, assets))
    assert np.mean([frame.realism["caption"] for frame in frames]) == pytest.approx(0.25, abs=0.12)
    assert not any(frame.realism["infrared_night"] for frame in frames)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"infrared_share": 2.0}, "infrared_share is 2: expected 0 to 1"),
        ({"reach_m": (0.0, 5.0)}, r"reach_m is \(0, 5\): expected low <= high"),
        ({"caption_share": float("nan")}, "caption_share is nan: expected 0 to 1"),
    ],
)
def test_a_wrong_setting_is_named(values, message: str):
    with pytest.raises(SettingsError, match=message):
        TrapSettings(**values)


def test_what_is_off_is_not_in_the_record_of_the_settings():
    assert not {"trap", "negatives"} & set(SimulatorSettings().to_dict())
