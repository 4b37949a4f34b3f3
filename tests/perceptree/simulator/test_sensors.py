"""Sensor models: errors follow the settings, and sky has no reading."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from calib import PinholeCamera
from perceptree.simulator.sensors.depth import MeasuredDepth, measure_depth
from perceptree.simulator.sensors.precipitation import draw_precipitation
from perceptree.simulator.sensors.rgb import expose
from perceptree.simulator.sensors.smooth import smooth_noise
from perceptree.simulator.settings import DepthSettings, RgbSettings

CAMERA = PinholeCamera(320, 180, 180.0, 180.0, 159.5, 89.5)
SHAPE = (180, 320)
BASELINE_M = 0.12
FB = CAMERA.fx * BASELINE_M
STEREO = DepthSettings(
    kinds={"stereo": 1.0},
    baseline_m=(BASELINE_M, BASELINE_M),
    disparity_noise_px=(0.0, 0.0),
    disparity_step_px=0.001,
    stereo_range_m=(20.0, 20.0),
    holes=(0.0, 0.0),
    half_resolution=False,
)
TOF = replace(STEREO, kinds={"tof": 1.0}, tof_noise_per_m=(0.0, 0.0), tof_range_m=(10.0, 10.0))
PLAIN = RgbSettings(
    exposure=(0.7, 0.7),
    noise=(0.0, 0.0),
    blur_px=(0.0, 0.0),
    motion_share=0.0,
    white_balance=(0.0, 0.0),
)


def flat(depth_m: float) -> np.ndarray:
    return np.full(SHAPE, depth_m, np.float32)


def post(near_m: float = 2.0, far_m: float = 6.0) -> np.ndarray:
    """A post in front of a wall, in columns 150 to 169."""
    depth_m = flat(far_m)
    depth_m[:, 150:170] = near_m
    return depth_m


def measure(depth_m: np.ndarray, settings: DepthSettings, seed: int = 1) -> MeasuredDepth:
    return measure_depth(np.random.default_rng(seed), settings, depth_m, CAMERA)


def light(level: float = 0.2) -> tuple[np.ndarray, float]:
    """Smooth grey samples around ``level``, and their mean log luminance."""
    ramp = np.linspace(0.25, 2.0, 2 * SHAPE[1], dtype=np.float32) * np.float32(level)
    samples = np.ascontiguousarray(np.broadcast_to(ramp[None, :, None], (360, 640, 3)))
    return samples, float(np.log(ramp).mean())


def shoot(settings: RgbSettings, level: float = 0.2, darkness: float = 0.0) -> np.ndarray:
    samples, log_luminance = light(level)
    return expose(np.random.default_rng(2), settings, samples, log_luminance, darkness)


@pytest.mark.parametrize("sigma_px", [0.8, 1.2, 3.0, 8.0])
def test_smooth_noise_has_unit_variance_and_is_shared_by_neighbours(sigma_px: float):
    noise = smooth_noise(np.random.default_rng(0), (900, 1200), sigma_px)
    assert noise.std() == pytest.approx(1, rel=0.05)
    assert (noise[:, 1:] * noise[:, :-1]).mean() > 0.6


@pytest.mark.parametrize("settings", [STEREO, TOF], ids=["stereo", "tof"])
def test_without_faults_the_exact_depth_comes_back_within_its_step(settings: DepthSettings):
    exact = np.tile(np.linspace(1.0, 9.0, SHAPE[1], dtype=np.float32), (SHAPE[0], 1))
    exact[:, 100:130] = 1.5
    step_m = 0.001 if settings is TOF else 0.001 * exact**2 / FB
    measured = measure(exact, settings).depth_m
    assert (np.abs(measured - exact) <= 0.55 * step_m + 1e-4).all()


def test_half_resolution_fills_blocks_with_the_mean_or_the_nearest():
    exact = post()
    exact[:, 151] = 6.0
    measured = measure(exact, replace(STEREO, half_resolution=True)).depth_m
    assert measured.shape == SHAPE
    assert (measured[::2] == measured[1::2]).all()
    assert measured[50, 150:152] == pytest.approx([2.0, 2.0], abs=1e-3)
    slope = np.tile(np.linspace(2, 9, SHAPE[1], dtype=np.float32), (SHAPE[0], 1))
    measured = measure(slope, replace(STEREO, half_resolution=True)).depth_m
    assert abs((measured - slope).mean()) < 3e-3


@pytest.mark.parametrize("z_m", [2.0, 4.0, 8.0])
def test_stereo_noise_grows_with_the_square_of_the_distance(z_m: float):
    measured = measure(flat(z_m), replace(STEREO, disparity_noise_px=(0.15, 0.15)))
    assert measured.depth_m.std() == pytest.approx(z_m**2 / FB * 0.15, rel=0.15)
    assert measured.noise == 0.15
    assert measured.baseline_m == BASELINE_M


@pytest.mark.parametrize("settings", [STEREO, TOF], ids=["stereo", "tof"])
def test_noise_carries_no_reading_over_the_range(settings: DepthSettings):
    noisy = replace(settings, disparity_noise_px=(0.2, 0.2), tof_noise_per_m=(0.001, 0.001))
    measured = measure(flat(9.95), replace(noisy, stereo_range_m=(10.0, 10.0))).depth_m
    assert 0.2 < (measured > 0).mean() < 0.9
    assert measured.max() <= 10.0


@pytest.mark.parametrize("z_m", [2.0, 4.0, 8.0])
def test_tof_noise_grows_with_the_square_of_the_distance(z_m: float):
    measured = measure(flat(z_m), replace(TOF, tof_noise_per_m=(0.001, 0.001)))
    assert measured.depth_m.std() == pytest.approx(0.001 * z_m**2, rel=0.1)
    assert (measured.kind, measured.baseline_m) == ("tof", 0.0)


def test_stereo_depths_are_those_of_whole_disparity_steps():
    exact = np.tile(np.linspace(1.0, 9.0, SHAPE[1], dtype=np.float32), (SHAPE[0], 1))
    settings = replace(STEREO, disparity_step_px=0.25, disparity_noise_px=(0.1, 0.1))
    measured = measure(exact, settings).depth_m
    steps = FB / np.unique(measured) / 0.25
    assert len(steps) > 40
    assert np.abs(steps - np.rint(steps)).max() < 1e-3


@pytest.mark.parametrize("settings", [STEREO, TOF], ids=["stereo", "tof"])
@pytest.mark.parametrize("holes", [0.0, 1.0])
@pytest.mark.parametrize("half", [False, True])
def test_sky_far_and_very_near_surfaces_have_no_reading(
    settings: DepthSettings, holes: float, half: bool
):
    exact = flat(4.0)
    exact[:60] = 0
    exact[60:100] = 25.0
    exact[140:] = 0.1
    faulty = replace(settings, holes=(holes, holes), half_resolution=half)
    seen = measure(exact, faulty).depth_m > 0
    assert not seen[:98].any()
    assert not seen[142:].any()
    assert seen[110:130, 100:].mean() > 0.8


def test_holes_of_stereo_lie_on_the_occluded_side_of_near_things():
    exact = post()
    strip_px = FB / 2.0 - FB / 6.0
    hole = np.mean(
        [measure(exact, replace(STEREO, holes=(1.0, 1.0)), seed).depth_m == 0 for seed in range(8)],
        axis=(0, 1),
    )
    beside = int(strip_px) - 1
    assert hole[150 - beside : 149].mean() > 0.6
    assert hole[151:169].max() < 0.2
    assert hole[172 : 172 + beside].mean() < 0.15
    assert hole[: int(FB / 6.0) - 1].min() > 0.9
    assert hole[30:130].mean() < 0.1
    assert (measure(exact, STEREO).depth_m > 0).all()


def test_the_foreground_bleeds_over_the_edge_by_a_pixel_or_two():
    measured = measure(post(), replace(STEREO, holes=(0.2, 0.2))).depth_m
    near = (np.abs(measured - 2.0) < 0.05).mean(0)
    assert near[169] > 0.9
    assert near[170] > 0.4
    assert near[173:].max() == 0


def test_tof_mixes_depths_at_edges_alone():
    measured = measure(post(), replace(TOF, holes=(1.0, 1.0))).depth_m
    mixed = ((measured > 2.01) & (measured < 5.99)).mean(0)
    lost = (measured == 0).mean(0)
    edges = [149, 150, 169, 170]
    assert mixed[edges].min() > 0.15
    assert lost[edges].min() > 0.25
    assert mixed[151:169].max() == 0
    assert mixed[:148].max() == 0
    assert measured.max() < 6.01


def test_tof_loses_oblique_surfaces_before_those_seen_head_on():
    head_on = measure(flat(8.0), replace(TOF, holes=(1.0, 1.0))).depth_m
    rows = np.arange(SHAPE[0], dtype=np.float32)[:, None]
    floor = np.tile(np.float32(180 * 0.6) / (rows + 1), (1, SHAPE[1])).astype(np.float32)
    oblique = measure(floor, replace(TOF, holes=(1.0, 1.0))).depth_m
    far = (floor > 7.0) & (floor < 9.0)
    assert (oblique[far] == 0).mean() > (head_on == 0).mean() + 0.3


def test_measured_depth_is_the_same_with_any_number_of_threads_and_the_same_seed():
    settings = DepthSettings()
    before = numba.get_num_threads()
    first = measure(post(), settings, 5)
    numba.set_num_threads(1)
    again = measure(post(), settings, 5)
    numba.set_num_threads(before)
    assert (first.depth_m == again.depth_m).all()
    assert (measure(post(), settings, 6).depth_m != first.depth_m).any()


def test_more_light_on_a_pixel_never_makes_it_darker():
    columns = shoot(PLAIN).astype(int)[90, 40:280].min(-1)
    assert (np.diff(columns) >= 0).all()
    assert columns[-1] - columns[0] > 60


def test_the_exposure_is_metered():
    assert shoot(PLAIN, 0.2).mean() == pytest.approx(shoot(PLAIN, 0.4).mean(), abs=0.5)


def test_the_exposure_left_at_dusk_is_a_setting():
    dark, bright = (
        shoot(replace(PLAIN, dusk_exposure=share), darkness=1.0).mean() for share in (0.3, 1.0)
    )
    assert dark < 0.8 * bright
    assert bright == shoot(PLAIN).mean()


def test_haze_takes_range_and_adds_noise_where_the_settings_say_so():
    noisy = replace(STEREO, disparity_noise_px=(0.1, 0.1), holes=(0.0, 0.0))
    shades = {
        kind: replace(start, in_haze=True, holes=(1.0, 1.0))
        for kind, start in (("stereo", noisy), ("tof", TOF))
    }

    def read(settings: DepthSettings, z_m: float, haze_per_m: float) -> np.ndarray:
        rng = np.random.default_rng(3)
        return measure_depth(rng, settings, flat(z_m), CAMERA, haze_per_m).depth_m

    exact = replace(noisy, in_haze=True)
    clear, thick = (read(exact, 6.0, haze).std() for haze in (0.0, 0.1))
    assert thick == pytest.approx(clear * np.exp(0.6), rel=0.1)
    assert not read(exact, 17.0, 0.1).any()  # less than a fifth of the contrast is left
    for settings in shades.values():
        lost = [(read(settings, 9.0, haze) == 0).mean() for haze in (0.0, 0.06, 0.2)]
        assert lost[0] <= lost[1] < lost[2]
        assert lost[2] > 0.9
    assert np.array_equal(read(noisy, 6.0, 0.1), read(noisy, 6.0, 0.0))


def test_dusk_is_darker_and_noisier():
    noisy = replace(PLAIN, noise=(0.01, 0.01))
    day, dusk = shoot(PLAIN).astype(float), shoot(PLAIN, darkness=1.0).astype(float)
    assert dusk.mean() < 0.85 * day.mean()
    day_noise = (shoot(noisy) - day)[:, 120:200].std()
    dusk_noise = (shoot(noisy, darkness=1.0) - dusk)[:, 120:200].std()
    assert day_noise == pytest.approx(0.01 * 255, rel=0.25)
    assert dusk_noise > 2.4 * day_noise


def test_noise_is_strongest_in_dark_tones_and_fades_in_highlights():
    noisy = replace(PLAIN, noise=(0.02, 0.02), exposure=(3.0, 3.0))
    clean = shoot(replace(noisy, noise=(0.0, 0.0))).astype(float)
    spread = (shoot(noisy) - clean).std((0, 2))
    assert spread[:40].mean() > 2 * spread[-40:].mean()


def test_a_white_balance_error_moves_red_and_blue_alone():
    warm = replace(PLAIN, white_balance=(0.12, 0.12))
    shift = shoot(warm).astype(float).mean((0, 1)) - shoot(PLAIN).astype(float).mean((0, 1))
    assert shift[0] > 3
    assert shift[2] > 3
    assert shift[1] == 0


@pytest.mark.parametrize(
    "blur", [{"blur_px": (1.5, 1.5)}, {"motion_share": 1.0, "motion_px": (8.0, 8.0)}]
)
def test_blur_and_motion_smear_edges(blur: dict):
    samples = np.full((360, 640, 3), 0.05, np.float32)
    samples[100:260, 200:440] = 0.5
    sharp, smeared = (
        expose(np.random.default_rng(3), settings, samples, -2.0).astype(int)
        for settings in (PLAIN, replace(PLAIN, **blur))
    )
    corners = np.abs(np.diff(sharp[..., 1], axis=1)).sum(1).max()
    assert (np.abs(sharp - smeared) > 20).sum() > 500
    assert np.abs(np.diff(smeared[..., 1], axis=1)).sum(1).max() == pytest.approx(corners, rel=0.1)


def test_the_image_is_the_same_with_any_number_of_threads():
    before = numba.get_num_threads()
    first = shoot(RgbSettings())
    numba.set_num_threads(1)
    again = shoot(RgbSettings())
    numba.set_num_threads(before)
    assert first.tobytes() == again.tobytes()


DARK = np.full((*SHAPE, 3), 60, np.uint8)
DARK[140:] = 180
RAIN_AND_SNOW = pytest.mark.parametrize(("rain", "snow"), [(0.8, 0.0), (0.0, 0.8)])


def fall(depth_m: np.ndarray, rain: float, snow: float, seed: int = 4) -> np.ndarray:
    return draw_precipitation(np.random.default_rng(seed), DARK, depth_m, CAMERA, rain, snow)


def changed(depth_m: np.ndarray, rain: float, snow: float) -> int:
    return int((fall(depth_m, rain, snow) != DARK).sum())


def test_no_precipitation_leaves_the_image():
    assert (fall(flat(0.0), 0.0, 0.0) == DARK).all()


@RAIN_AND_SNOW
def test_particles_brighten_the_open_view_and_are_hidden_behind_near_surfaces(rain, snow):
    depth_m = flat(0.0)
    depth_m[:, :160] = 0.3
    drawn = fall(depth_m, rain, snow)
    assert (drawn[:, :160] == DARK[:, :160]).all()
    assert (drawn[:140, 160:] > 64).any(-1).mean() > 0.005
    deep, shallow = (changed(flat(z_m), rain, snow) for z_m in (15.0, 3.0))
    assert deep > 2 * shallow > 0


@RAIN_AND_SNOW
def test_precipitation_grows_with_its_strength_and_repeats_with_its_seed(rain, snow):
    assert changed(flat(0.0), rain, snow) > 2 * changed(flat(0.0), rain / 4, snow / 4)
    strong = fall(flat(0.0), rain, snow)
    assert strong.tobytes() == fall(flat(0.0), rain, snow).tobytes()
    assert strong.tobytes() != fall(flat(0.0), rain, snow, 5).tobytes()


def test_rain_falls_along_the_vertical_given():
    for up, along, across in (((0.0, -1.0, 0.0), 0, 1), ((1.0, 0.0, 0.0), 1, 0)):
        rng = np.random.default_rng(1)
        drawn = draw_precipitation(rng, DARK, flat(4.0), CAMERA, 0.3, 0.0, up)
        grey = drawn[:140, :, 1].astype(float)
        steps = [np.abs(np.diff(grey, axis=axis)).sum() for axis in (along, across)]
        assert steps[0] < 0.85 * steps[1]
