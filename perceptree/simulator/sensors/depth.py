"""The depth sensor: what a stereo or a time-of-flight camera makes of the exact depth."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import cv2
import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera
from perceptree.simulator.sensors.kernels import invert_depth, mark_unseen
from perceptree.simulator.sensors.smooth import smooth_noise
from perceptree.simulator.settings import DepthSettings

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_EDGE_RATIO = 1.06
_SEARCH_SHARE = 0.2
_UNSEEN_PX = 0.75
_JUMP_PX = 0.5
_MATCH_SIGMA_PX = 1.2
_LUCK_SIGMA_PX = 2.0
_PATCH_SIGMA_PX = 8.0
_PATCH_SHARE = 0.03
_LEAST_CONTRAST = np.float32(0.2)
_SKY_M = 1000.0
_TOF_NEAREST_M = 0.2
_TOF_FLOOR_M = 0.0015
_TOF_HEADROOM = 1.5
_TOF_SIGMA_PX = 0.8
_TOF_STEP_M = 0.001
_REFLECTANCE_LOG_STD = 0.3


@dataclass(frozen=True)
class MeasuredDepth:
    """``depth_m`` (H, W) float32 along the optical axis, 0 for no reading, and what was drawn.

    ``baseline_m`` is 0 for a time-of-flight camera; ``noise`` is the deviation of the disparity
    in px for stereo, and that of the depth over its square, 1/m, for time of flight.
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
    """A depth camera's reading of ``depth_m`` (H, W), exact along the optical axis, 0 on sky.

    H and W must be even where the sensor has half the resolution. ``haze_per_m`` is the air's
    extinction, which counts where the settings say so.
    """
    kinds = [kind for kind, weight in settings.kinds.items() if weight > 0]
    weights = np.array([settings.kinds[kind] for kind in kinds])
    kind = str(rng.choice(kinds, p=weights / weights.sum()))
    holes = float(rng.uniform(*settings.holes))
    side = 2 if settings.half_resolution else 1
    inverse = np.empty((depth_m.shape[0] // side, depth_m.shape[1] // side), np.float32)
    invert_depth(depth_m, side, np.float32(_EDGE_RATIO), inverse)
    small = camera.scaled(inverse.shape[1], inverse.shape[0])
    sensor = _stereo if kind == "stereo" else _time_of_flight
    haze = np.float32(haze_per_m if settings.in_haze else 0.0)
    measured = sensor(rng, settings, inverse, small, holes, haze)
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
    """Disparity f b / z with a matcher's faults: noise, steps, holes and bleeding at edges.

    The image is the left one of the pair, so the strip that the right camera does not see lies
    left of near objects, and at the left border. In ``haze``, per metre, contrast falls to
    exp(-haze z) (Koschmieder 1924): the noise grows by as much, and where too little is left
    nothing is matched.
    """
    baseline = float(rng.uniform(*settings.baseline_m))
    noise = float(rng.uniform(*settings.disparity_noise_px))
    reach = float(rng.uniform(*settings.stereo_range_m))
    side = 2 if settings.half_resolution else 1
    scale = np.float32(camera.fx * baseline)
    disparity = inverse * scale
    lost = np.zeros(inverse.shape, np.bool_)
    if holes > 0:
        disparity, lost = _match(rng, disparity, holes)
    lost |= (disparity < scale / np.float32(reach)) | (disparity > _SEARCH_SHARE * camera.width)
    step = np.float32(settings.disparity_step_px / side)
    error = np.float32(noise / side) * smooth_noise(rng, inverse.shape, _MATCH_SIGMA_PX)
    if haze > 0:
        contrast = np.exp(-haze / np.maximum(inverse, np.float32(1 / _SKY_M)))
        lost |= contrast < _LEAST_CONTRAST
        error /= np.maximum(contrast, _LEAST_CONTRAST)
    disparity += error
    disparity = np.maximum(np.rint(disparity / step) * step, step)
    measured = np.where(lost, np.float32(0), scale / disparity)
    measured[measured > reach] = 0
    return MeasuredDepth(measured, "stereo", baseline, noise, reach)


def _match(rng: np.random.Generator, disparity: Float32, holes: float) -> tuple[Float32, Mask]:
    """What matching windows make of edges: disparities (H, W) and where there is no reading.

    A window misses twigs thinner than half of it, and beside an edge it often answers with the
    nearer surface, which so bleeds over by a pixel. ``holes`` decides what share of the other
    pixels there, and of those that the right camera does not see, is lost; so are some patches
    without texture.
    """
    luck = smooth_noise(rng, disparity.shape, _LUCK_SIGMA_PX)
    matched = np.asarray(cv2.medianBlur(disparity, 3), np.float32)
    unseen = np.empty(disparity.shape, np.bool_)
    mark_unseen(matched, np.float32(_UNSEEN_PX), unseen)
    grown = np.asarray(cv2.dilate(matched, np.ones((3, 3), np.uint8)), np.float32)
    edge = grown - matched > _JUMP_PX
    bled = edge & (luck < 0.5)
    lost = unseen & ~bled & (luck < 4 * holes - 1.5)
    lost |= edge & (luck > 2.0 - 1.5 * holes)
    patches = smooth_noise(rng, disparity.shape, _PATCH_SIGMA_PX) + np.float32(0.15) * luck
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
    """Noise of k z², mixed depths and holes at edges, weak returns lost, steps of 1 mm.

    The noise is at least 1.5 mm, unless k is 0, and smooth over a pixel. ``haze``, per metre,
    takes light on the way there and back: the noise grows as the root of what is left falls.
    """
    noise = float(rng.uniform(*settings.tof_noise_per_m))
    reach = float(rng.uniform(*settings.tof_range_m))
    depth = np.asarray(1 / np.maximum(inverse, np.float32(0.5 / reach)), np.float32)
    lost = depth < _TOF_NEAREST_M
    if holes > 0:
        depth, faults = _returns(rng, depth, camera, reach, holes, haze)
        lost |= faults
    if noise > 0:
        deviation = np.maximum(np.float32(noise) * depth * depth, np.float32(_TOF_FLOOR_M))
        if haze > 0:
            deviation *= np.exp(haze * depth)
        depth += deviation * smooth_noise(rng, depth.shape, _TOF_SIGMA_PX)
    step = np.float32(_TOF_STEP_M)
    lost |= depth > reach
    measured = np.where(lost, np.float32(0), np.maximum(np.rint(depth / step), 1) * step)
    return MeasuredDepth(measured, "tof", 0.0, noise, reach)


def _returns(
    rng: np.random.Generator,
    depth: Float32,
    camera: PinholeCamera,
    reach: float,
    holes: float,
    haze: np.float32,
) -> tuple[Float32, Mask]:
    """Depths (H, W) with flying pixels at edges, and where a return is mixed or too weak.

    A return is as strong as reflectance times the cosine of incidence over z², less what the
    haze takes; the range is what a middling surface seen head-on gives with some strength to
    spare.
    """
    window = np.ones((3, 3), np.uint8)
    near = np.asarray(cv2.erode(depth, window), np.float32)
    far = np.asarray(cv2.dilate(depth, window), np.float32)
    edge = far > near * np.float32(_EDGE_RATIO)
    luck = rng.random(depth.shape, np.float32)
    mixed = edge & (luck < 0.5 * holes)
    gone = edge & (luck > 1 - 0.5 * holes)
    share = (luck / np.float32(0.5 * holes)) ** 3
    flying = np.where(mixed, near + share * (far - near), depth)

    right = cv2.Sobel(depth, -1, 1, 0, scale=camera.fx / 8)
    down = cv2.Sobel(depth, -1, 0, 1, scale=camera.fy / 8)
    squared_cosine = 1 / (1 + (right * right + down * down) / (depth * depth))
    squared_cosine[edge] = 1
    dark = smooth_noise(rng, depth.shape, _PATCH_SIGMA_PX) * np.float32(_REFLECTANCE_LOG_STD)
    strength = (np.exp(2 * dark) * squared_cosine * _TOF_HEADROOM**2) ** np.float32(holes)
    if haze > 0:
        strength *= np.exp(-4 * haze * depth)
    weak = strength < (depth / np.float32(reach)) ** 4
    return flying, gone | weak
