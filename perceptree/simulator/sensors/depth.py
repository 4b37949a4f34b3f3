"""Depth sensor models: stereo and time-of-flight cameras with their errors."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import cv2
import numpy as np

from basetree.arrays import Bool, Float32
from calib import PinholeCamera
from perceptree.simulator.sensors.kernels import invert_depth, mark_unseen
from perceptree.simulator.sensors.smooth import smooth_noise
from perceptree.simulator.settings import DepthSettings

_EDGE_RATIO = 1.06  # depth ratio of neighbouring pixels at an edge
_SEARCH_SHARE = 0.2  # largest disparity that is searched, over the image width
_UNSEEN_PX = 0.75  # disparity tolerance for what the right camera can see
_JUMP_PX = 0.5  # disparity difference of neighbouring pixels at an edge
_MATCH_SIGMA_PX = 1.2  # correlation of the disparity noise, from the matching window
_CHANCE_SIGMA_PX = 2.0  # correlation of the field that decides which readings fail
_PATCH_SIGMA_PX = 8.0  # size of patches without texture or with other reflectance
_PATCH_SHARE = 0.03  # largest fraction of patches without texture
_LEAST_CONTRAST = np.float32(0.2)
_SKY_M = 1000.0  # depth of the sky for the contrast in haze
_TOF_NEAREST_M = 0.2
_TOF_FLOOR_M = 0.0015  # smallest standard deviation
_TOF_HEADROOM = 1.5  # strength of a medium return at the maximum range, over the limit
_TOF_SIGMA_PX = 0.8  # correlation of the noise
_TOF_STEP_M = 0.001
_REFLECTANCE_LOG_STD = 0.3


@dataclass(frozen=True)
class MeasuredDepth:
    """A measured depth map and the parameters of its sensor.

    Attributes:
        depth_m: (H, W) float32 depth along the optical axis, m; 0 where there is no reading.
        kind: `stereo` or `tof`.
        baseline_m: Baseline of the stereo camera, m; 0 for time of flight.
        noise: Standard deviation of the disparity, px, for stereo; of the depth divided by its
            square, 1/m, for time of flight.
        range_m: Maximum depth, m.
    """

    depth_m: Float32
    kind: str
    baseline_m: float
    noise: float
    range_m: float


def measure_depth(
    rng: np.random.Generator,
    settings: DepthSettings,
    depth_m: Float32,
    camera: PinholeCamera,
    haze_per_m: float = 0.0,
) -> MeasuredDepth:
    """Simulate a depth camera.

    Args:
        rng: Source of random numbers.
        settings: Kinds and ranges of the sensor's parameters.
        depth_m: (H, W) float32 exact depth along the optical axis, m; 0 on sky. H and W must be
            even for a sensor with half the resolution.
        camera: Intrinsics of the image.
        haze_per_m: Extinction of the air, 1/m; ignored unless `settings.in_haze`.
    """
    kinds = [kind for kind, weight in settings.kinds.items() if weight > 0]
    weights = np.array([settings.kinds[kind] for kind in kinds])
    kind = str(rng.choice(kinds, p=weights / weights.sum()))
    holes = float(rng.uniform(*settings.holes))
    side = 2 if settings.half_resolution else 1
    inverse = np.empty((depth_m.shape[0] // side, depth_m.shape[1] // side), np.float32)
    invert_depth(depth_m, side, np.float32(_EDGE_RATIO), inverse)
    small = camera.scaled(inverse.shape[1], inverse.shape[0])
    haze = np.float32(haze_per_m if settings.in_haze else 0.0)
    measured = _SENSORS[kind](rng, settings, inverse, small, holes, haze)
    full = np.repeat(np.repeat(measured.depth_m, side, 0), side, 1)
    return MeasuredDepth(full, kind, measured.baseline_m, measured.noise, measured.range_m)


def _stereo(
    rng: np.random.Generator,
    settings: DepthSettings,
    inverse: Float32,
    camera: PinholeCamera,
    holes: float,
    haze: np.float32,
) -> MeasuredDepth:
    """Disparity f b / z with a matcher's errors: noise, steps, holes and bleeding at edges.

    The image is the left one of the pair, so the right camera cannot see a strip to the left of
    near objects and at the left border. In haze of extinction `haze` (1/m) contrast decreases to
    exp(-haze z) (Koschmieder 1924). The noise is divided by the contrast, and pixels with too
    little contrast have no reading.
    """
    baseline = float(rng.uniform(*settings.baseline_m))
    noise = float(rng.uniform(*settings.disparity_noise_px))
    range_m = float(rng.uniform(*settings.stereo_range_m))
    side = 2 if settings.half_resolution else 1
    scale = np.float32(camera.fx * baseline)
    disparity = inverse * scale
    lost = np.zeros(inverse.shape, np.bool_)
    if holes > 0:
        disparity, lost = _match(rng, disparity, holes)
    lost |= (disparity < scale / np.float32(range_m)) | (disparity > _SEARCH_SHARE * camera.width)
    step = np.float32(settings.disparity_step_px / side)
    error = np.float32(noise / side) * smooth_noise(rng, inverse.shape, _MATCH_SIGMA_PX)
    if haze > 0:
        contrast = np.exp(-haze / np.maximum(inverse, np.float32(1 / _SKY_M)))
        lost |= contrast < _LEAST_CONTRAST
        error /= np.maximum(contrast, _LEAST_CONTRAST)
    disparity += error
    disparity = np.maximum(np.rint(disparity / step) * step, step)
    measured = np.where(lost, np.float32(0), scale / disparity)
    measured[measured > range_m] = 0
    return MeasuredDepth(measured, "stereo", baseline, noise, range_m)


def _match(rng: np.random.Generator, disparity: Float32, holes: float) -> tuple[Float32, Bool]:
    """Simulate the errors of window matching: disparities (H, W) and where there is no reading.

    A window misses twigs thinner than half its size. Next to an edge it often returns the nearer
    surface, which so extends by a pixel. `holes` scales the fraction of lost readings: at edges,
    where the right camera cannot see, and in patches without texture.
    """
    chance = smooth_noise(rng, disparity.shape, _CHANCE_SIGMA_PX)
    matched = np.asarray(cv2.medianBlur(disparity, 3), np.float32)
    unseen = np.empty(disparity.shape, np.bool_)
    mark_unseen(matched, np.float32(_UNSEEN_PX), unseen)
    grown = np.asarray(cv2.dilate(matched, np.ones((3, 3), np.uint8)), np.float32)
    edge = grown - matched > _JUMP_PX
    bled = edge & (chance < 0.5)
    lost = unseen & ~bled & (chance < 4 * holes - 1.5)
    lost |= edge & (chance > 2.0 - 1.5 * holes)
    patches = smooth_noise(rng, disparity.shape, _PATCH_SIGMA_PX) + np.float32(0.15) * chance
    lost |= patches > NormalDist().inv_cdf(1 - _PATCH_SHARE * holes)
    return np.where(bled, grown, matched), lost


def _time_of_flight(
    rng: np.random.Generator,
    settings: DepthSettings,
    inverse: Float32,
    camera: PinholeCamera,
    holes: float,
    haze: np.float32,
) -> MeasuredDepth:
    """Depth with noise k z², mixed depths and holes at edges, lost weak returns, and 1 mm steps.

    The noise is at least 1.5 mm, unless k is 0. Haze of extinction `haze` (1/m) absorbs light
    on the way there and back; the noise grows with 1 over the square root of the remaining light.
    """
    noise = float(rng.uniform(*settings.tof_noise_per_m))
    range_m = float(rng.uniform(*settings.tof_range_m))
    depth = np.asarray(1 / np.maximum(inverse, np.float32(0.5 / range_m)), np.float32)
    lost = depth < _TOF_NEAREST_M
    if holes > 0:
        depth, faults = _returns(rng, depth, camera, range_m, holes, haze)
        lost |= faults
    if noise > 0:
        deviation = np.maximum(np.float32(noise) * depth * depth, np.float32(_TOF_FLOOR_M))
        if haze > 0:
            deviation *= np.exp(haze * depth)
        depth += deviation * smooth_noise(rng, depth.shape, _TOF_SIGMA_PX)
    step = np.float32(_TOF_STEP_M)
    lost |= depth > range_m
    measured = np.where(lost, np.float32(0), np.maximum(np.rint(depth / step), 1) * step)
    return MeasuredDepth(measured, "tof", 0.0, noise, range_m)


def _returns(
    rng: np.random.Generator,
    depth: Float32,
    camera: PinholeCamera,
    range_m: float,
    holes: float,
    haze: np.float32,
) -> tuple[Float32, Bool]:
    """Depths (H, W) with flying pixels at edges, and where a return is missing or too weak.

    The strength of a return is reflectance times the cosine of incidence over z², reduced by
    haze. A surface of medium reflectance at the maximum range, seen head-on, still has a reading
    with some reserve.
    """
    window = np.ones((3, 3), np.uint8)
    near = np.asarray(cv2.erode(depth, window), np.float32)
    far = np.asarray(cv2.dilate(depth, window), np.float32)
    edge = far > near * np.float32(_EDGE_RATIO)
    chance = rng.random(depth.shape, np.float32)
    mixed = edge & (chance < 0.5 * holes)
    gone = edge & (chance > 1 - 0.5 * holes)
    share = (chance / np.float32(0.5 * holes)) ** 3
    flying = np.where(mixed, near + share * (far - near), depth)

    right = cv2.Sobel(depth, -1, 1, 0, scale=camera.fx / 8)
    down = cv2.Sobel(depth, -1, 0, 1, scale=camera.fy / 8)
    squared_cosine = 1 / (1 + (right * right + down * down) / (depth * depth))
    squared_cosine[edge] = 1
    dark = smooth_noise(rng, depth.shape, _PATCH_SIGMA_PX) * np.float32(_REFLECTANCE_LOG_STD)
    strength = (np.exp(2 * dark) * squared_cosine * _TOF_HEADROOM**2) ** np.float32(holes)
    if haze > 0:
        strength *= np.exp(-4 * haze * depth)
    weak = strength < (depth / np.float32(range_m)) ** 4
    return flying, gone | weak


_SENSORS = {"stereo": _stereo, "tof": _time_of_flight}
