"""What depth cameras of other kinds read of exact depth.

Depths are (H, W) float32 metres, infinite where there is no reading.
"""

from __future__ import annotations

import cv2
import numpy as np

from basetree.arrays import Bool, Float32, UInt8
from calib import DepthEncoding, encode_depth
from perceptree.data.augment.depth import hidden_from_right
from perceptree.data.augment.randomness import blobs, is_drawn, normal, uniform_up_to
from perceptree.data.augment.views import draw_log
from perceptree.settings.augmentation import AugmentSettings

_JUMP_PX = 0.5  # of disparity, at an edge
_JUMP_SHARE = 1.05  # of depth, at an edge
_FOCAL = (0.5, 1.2)  # focal length over the width
_BASELINE_M = (0.04, 0.2)
_DISPARITY_NOISE_PX = 0.3
_DISPARITY_STEPS_PX = (1, 1 / 4, 1 / 8, 1 / 16, 1 / 32)
_DISPARITY_SHARE = 0.25  # largest disparity that is searched, over the width
_TOF_NOISE_PER_M = 0.003
_TOF_FLOOR_M = 0.002
_LIDAR_NOISE_M = 0.02
_LOST_SHARE = 0.12  # largest share of the picture that is lost in patches
_RINGS_PX, _BEAMS_PX = 8, 3  # largest distance of a lidar's lines, and of the beams along them
_SPLAT_PX = 2
_GHOST_SHARE = 0.03  # largest movement since the earlier picture, over the width


def redraw(
    rng: np.random.Generator,
    depth_m: Float32,
    encoding: DepthEncoding,
    settings: AugmentSettings,
    least_range_m: float = 0.0,
) -> tuple[UInt8, UInt8]:
    """Draw a depth camera and what it reads.

    The readings are drawn at the sensor's size and brought back to the picture's: by the nearest
    reading, as drivers register depth, or by the interpolation of a model's input.

    Args:
        rng: Source of the random numbers.
        depth_m: Exact depth.
        encoding: Encoding of the result.
        settings: Kinds of cameras and ranges of their properties.
        least_range_m: The sensor reaches so far at least, so that there is something to see.

    Returns:
        (H, W) uint8 depth image, and the same with the gaps between a lidar's beams filled, for
        what it sees.
    """
    height, width = depth_m.shape
    x, y, across, down = cv2.boundingRect(np.isfinite(depth_m).view(np.uint8))
    drawn = np.full((height, width), encoding.invalid_value, np.uint8)
    if not across:
        return drawn, drawn
    scale = draw_log(rng, settings.camera_width_px) / width
    size = (max(8, round(across * scale)), max(8, round(down * scale)))
    part = np.ascontiguousarray(depth_m[y : y + down, x : x + across])
    small = np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_NEAREST), np.float32)
    kind = _draw_kind(rng, settings)
    read = _SENSORS[kind](rng, small, settings)
    range_m = max(draw_log(rng, settings.camera_range_m), least_range_m)
    read = np.where(read > range_m, np.float32(np.inf), read)
    if is_drawn(rng, settings.ghost_share):
        read = held(rng, read)
    if is_drawn(rng, 0.5):
        part = np.asarray(cv2.resize(read, (across, down), interpolation=cv2.INTER_NEAREST))
        found = encode_depth(part, encoding)
    else:
        way = cv2.INTER_AREA if scale > 1 else cv2.INTER_LINEAR
        found = np.asarray(
            cv2.resize(encode_depth(read, encoding), (across, down), interpolation=way), np.uint8
        )
    drawn[y : y + down, x : x + across] = found
    if kind != "lidar":
        return drawn, drawn
    return drawn, np.asarray(cv2.erode(drawn, np.ones((_RINGS_PX + 1,) * 2, np.uint8)), np.uint8)


def _draw_kind(rng: np.random.Generator, settings: AugmentSettings) -> str:
    kinds = sorted(kind for kind, weight in settings.camera_kinds.items() if weight > 0)
    shares = np.array([settings.camera_kinds[kind] for kind in kinds])
    return str(rng.choice(kinds, p=shares / shares.sum()))


def stereo(rng: np.random.Generator, depth_m: Float32, settings: AugmentSettings) -> Float32:
    """What a stereo pair reads: window matching, then the filters of its driver.

    Windows that reach over an edge find the nearer surface, which so grows in patches; what the
    right camera cannot see has no reading.
    """
    width = depth_m.shape[1]
    scale = np.float32(rng.uniform(*_FOCAL) * width * draw_log(rng, _BASELINE_M))
    disparity = (scale / depth_m).astype(np.float32)
    disparity = np.asarray(cv2.medianBlur(disparity, 3), np.float32)
    grow = int(rng.integers(settings.camera_matching_px + 1))
    tall = int(rng.integers(grow + 1))
    near = cv2.dilate(disparity, np.ones((2 * tall + 1, 2 * grow + 1), np.uint8))
    widened = near - disparity > _JUMP_PX
    widened &= blobs(rng, depth_m.shape, float(rng.uniform(0.3, 1)), float(rng.uniform(4, 24)))
    hidden = hidden_from_right(disparity) & ~widened
    disparity = np.where(widened, near, disparity).astype(np.float32)
    noise = np.asarray(cv2.GaussianBlur(normal(rng, depth_m.shape), (0, 0), 1.2), np.float32)
    disparity += np.where(disparity > 0, noise * (4 * uniform_up_to(rng, _DISPARITY_NOISE_PX)), 0)
    step = np.float32(rng.choice(_DISPARITY_STEPS_PX))
    disparity = np.maximum(np.rint(disparity / step) * step, 0)
    lost = (
        hidden | (disparity < 1) | (disparity > _DISPARITY_SHARE * width) | _patches(rng, depth_m)
    )
    with np.errstate(divide="ignore"):
        found = np.where(lost, np.float32(np.inf), scale / disparity).astype(np.float32)
    return _FILTERS[int(rng.integers(len(_FILTERS)))](rng, found)


def time_of_flight(
    rng: np.random.Generator, depth_m: Float32, settings: AugmentSettings
) -> Float32:
    """What a time-of-flight camera reads: flying pixels and holes at edges, lost weak returns."""
    limit_m = np.float32(settings.camera_range_m[1])
    window, ended = np.ones((3, 3), np.uint8), np.minimum(depth_m, limit_m)
    near = np.asarray(cv2.erode(ended, window), np.float32)
    far = np.asarray(cv2.dilate(ended, window), np.float32)
    edge = far > near * np.float32(_JUMP_SHARE)
    chance = rng.random(depth_m.shape, np.float32)
    mixing, losing = uniform_up_to(rng, 0.6), uniform_up_to(rng, 0.4)
    mixed = edge & (chance < mixing)
    share = (chance / np.float32(max(mixing, 1e-3))) ** np.float32(rng.uniform(1, 4))
    found = np.where(mixed, near + share * (far - near), depth_m)
    lost = (edge & (chance > 1 - losing)) | _patches(rng, depth_m)
    squared = np.minimum(found, limit_m) ** 2
    deviation = np.maximum(uniform_up_to(rng, _TOF_NOISE_PER_M) * squared, _TOF_FLOOR_M)
    found = found + deviation.astype(np.float32) * normal(rng, depth_m.shape)
    return np.where(lost, np.float32(np.inf), found).astype(np.float32)


def lidar(rng: np.random.Generator, depth_m: Float32, settings: AugmentSettings) -> Float32:
    """What the beams of a lidar read: lines with gaps, bent as a turning head's are."""
    height, width = depth_m.shape
    rows = np.arange(height, dtype=np.float32)[:, None]
    across = np.linspace(-1, 1, width, dtype=np.float32)[None]
    bend = rng.uniform(-0.1, 0.1) * height
    tilt = rng.uniform(-0.05, 0.05) * height
    lines = rows + bend * across**2 + tilt * across + rng.uniform(0, _RINGS_PX)
    beams = np.arange(width, dtype=np.float32)[None] + rng.uniform(0, _BEAMS_PX)
    hit = (lines % rng.uniform(1, _RINGS_PX) < 1) & (beams % rng.uniform(1, _BEAMS_PX) < 1)
    hit &= rng.random(depth_m.shape, np.float32) > uniform_up_to(rng, 0.3)
    noisy = depth_m + np.float32(_LIDAR_NOISE_M) * normal(rng, depth_m.shape)
    found = np.where(hit, noisy, np.float32(np.inf)).astype(np.float32)
    side = 2 * int(rng.integers(_SPLAT_PX + 1)) + 1
    return np.asarray(cv2.erode(found, np.ones((side, side), np.uint8)), np.float32)


def exact(rng: np.random.Generator, depth_m: Float32, settings: AugmentSettings) -> Float32:
    """The depth as it is."""
    return depth_m


def held(rng: np.random.Generator, depth_m: Float32) -> Float32:
    """Show an earlier picture, taken from beside, where there is no reading."""
    move = rng.uniform(-_GHOST_SHARE, _GHOST_SHARE, 2) * depth_m.shape[1]
    matrix = np.array([[1, 0, move[0]], [0, 1, move[1] / 4]], np.float32)
    earlier = cv2.warpAffine(
        depth_m, matrix, depth_m.shape[::-1], flags=cv2.INTER_NEAREST, borderValue=(np.inf,)
    )
    return np.where(np.isfinite(depth_m), depth_m, earlier).astype(np.float32)


def _patches(rng: np.random.Generator, depth_m: Float32) -> Bool:
    """(H, W) patches whose readings are lost, and single readings."""
    share, single = uniform_up_to(rng, _LOST_SHARE), uniform_up_to(rng, 0.03)
    lost = blobs(rng, depth_m.shape, share, float(rng.uniform(4, 40)))
    return lost | (rng.random(depth_m.shape, np.float32) < single)


def _unfiltered(rng: np.random.Generator, depth_m: Float32) -> Float32:
    return depth_m


def _median(rng: np.random.Generator, depth_m: Float32) -> Float32:
    """The median of a window, without readings that have few beside them."""
    return np.asarray(cv2.medianBlur(depth_m, int(rng.choice([3, 5]))), np.float32)


def _mean(rng: np.random.Generator, depth_m: Float32) -> Float32:
    """The mean of the readings in a window."""
    read = np.isfinite(depth_m)
    box = (int(rng.choice([3, 5, 7, 9])),) * 2
    total = cv2.blur(np.where(read, depth_m, np.float32(0)), box)
    share = cv2.blur(read.astype(np.float32), box)
    return np.where(read, total / np.maximum(share, 1e-6), np.inf).astype(np.float32)


def _edge_preserving(rng: np.random.Generator, depth_m: Float32) -> Float32:
    """A bilateral filter, then holes filled from the left or with the farther side."""
    read = np.isfinite(depth_m)
    finite = np.where(read, depth_m, np.float32(0))
    smooth = cv2.bilateralFilter(finite, 5, float(rng.uniform(0.05, 0.5)), 2.5)
    found = np.where(read, smooth, np.float32(np.inf)).astype(np.float32)
    if is_drawn(rng, 0.5):
        return filled_from_left(found)
    return filled_with_farther(found, int(rng.integers(1, 4)))


def _dense(rng: np.random.Generator, depth_m: Float32) -> Float32:
    """Holes filled with the farther side, and edges that are ramps, as learned matching gives."""
    found = filled_with_farther(depth_m, 4)
    inverse = cv2.GaussianBlur((1 / found).astype(np.float32), (0, 0), float(rng.uniform(0.5, 2)))
    with np.errstate(divide="ignore"):
        return np.where(np.isfinite(found), 1 / inverse, np.inf).astype(np.float32)


def filled_from_left(depth_m: Float32) -> Float32:
    """Fill what has no reading with the last one left of it, if there is one."""
    columns = np.where(np.isfinite(depth_m), np.arange(depth_m.shape[1])[None], 0)
    last = np.maximum.accumulate(columns, axis=1)
    return np.take_along_axis(depth_m, last, axis=1)


def filled_with_farther(depth_m: Float32, reach_px: int) -> Float32:
    """Fill holes of up to twice `reach_px` with the farthest reading beside them."""
    read = np.isfinite(depth_m)
    window = np.ones((2 * reach_px + 1,) * 2, np.uint8)
    far = np.asarray(cv2.dilate(np.where(read, depth_m, np.float32(0)), window), np.float32)
    return np.where(read | (far <= 0), depth_m, far).astype(np.float32)


_FILTERS = (_unfiltered, _median, _mean, _edge_preserving, _dense)
_SENSORS = {"stereo": stereo, "tof": time_of_flight, "lidar": lidar, "exact": exact}
