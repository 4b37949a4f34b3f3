"""Silhouettes in a depth map, and the colour gradient across them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from basetree.arrays import Float, Float32, UInt8

_MOST_PER_FRAME: Final = 500

# The far side is at least this many times as far away as the near side.
_JUMP_RATIO = 1.15
# Twigs and leaves have no straight outline: least coherence of the gradient around an edge.
_MIN_COHERENCE = 0.7
_NORMAL_SIGMA_PX, _COHERENCE_SIGMA_PX = 2.0, 4.0
# Where depth ends because of the sensor's range there is no edge: least distance to that end, as a
# share of the range.
_RANGE_SHARE = 0.75
_COLOUR_SIGMA_PX = 1.0
# Gradient, grey levels per pixel, that is taken for noise.
_NOISE = 2.0
_HIGHEST_PEAK = 5.0
_REACH_SHARE = 0.0375


@dataclass(frozen=True, eq=False)
class Silhouettes:
    """Points on the near sides of jumps in depth, N at once, with the colour across them.

    Attributes:
        xy_px: (N, 2) pixel coordinates in the depth map, centres on whole numbers.
        normal: (N, 2) unit vectors in the image, from the near side to the far side.
        depth_m: (N,) depth of the near side.
        profile: (N, 2 R + 1) gradient of the colour along the normal, from R px on the near side
            to R px on the far side, relative to its mean there.
    """

    xy_px: Float
    normal: Float
    depth_m: Float
    profile: Float

    def __len__(self) -> int:
        return len(self.depth_m)


def reach_px(width: int) -> int:
    """The half-length R of a profile for a picture of this width, px."""
    return round(_REACH_SHARE * width)


def find_silhouettes(image: UInt8, depth_m: Float32, seed: int = 0) -> Silhouettes:
    """Find straight silhouettes, mostly of stems, and sample the colour across them.

    Args:
        image: (H, W, 3) uint8 BGR.
        depth_m: (H, W) metres, 0 = no reading, aligned with the image.
        seed: Chooses which silhouettes are used where there are more than `_MOST_PER_FRAME`.
    """
    nearness = np.where(depth_m > 0, 1 / np.maximum(depth_m, 0.05), 0).astype(np.float32)
    rows, columns, normal, near = _edges(np.asarray(cv2.medianBlur(nearness, 5), np.float32))
    reach = reach_px(depth_m.shape[1])
    height, width = depth_m.shape
    inside = (columns > reach) & (columns < width - 1 - reach)
    inside &= (rows > reach) & (rows < height - 1 - reach)
    chosen = np.flatnonzero(inside)
    if len(chosen) > _MOST_PER_FRAME:
        chosen = np.random.default_rng(seed).choice(chosen, _MOST_PER_FRAME, replace=False)
    xy = np.column_stack([columns, rows])[chosen]
    profile = _profiles(image, xy, normal[chosen], reach)
    return Silhouettes(xy, normal[chosen], 1 / near[chosen], profile)


def _edges(nearness: Float) -> tuple[Float, Float, Float, Float]:
    """Rows and columns (N,) of the edges, their normals (N, 2) and the nearness of the near side.

    Edges lie between two neighbouring pixels, so that one of their coordinates is half a pixel.
    """
    readings = nearness[nearness > 0]
    if not readings.size:
        none = np.zeros(0)
        return none, none, np.zeros((0, 2)), none
    range_m = 1 / float(np.quantile(readings, 0.02))
    gradient, coherence = _directions(nearness)
    found = []
    for axis in (1, 0):
        along = np.moveaxis(nearness, axis, 1)
        step = np.abs(np.diff(along, axis=1))
        middle = step[:, 1:-1]
        before, after = along[:, :-3], along[:, 3:]
        near, far = np.maximum(before, after), np.minimum(before, after)
        is_edge = (far * _JUMP_RATIO < near) & (middle >= step[:, :-2]) & (middle > step[:, 2:])
        is_edge &= (far > 0) | (near * _RANGE_SHARE * range_m > 1)
        row, column = np.nonzero(is_edge)
        near = near[row, column]
        at, across = (row, column + 1) if axis else (column + 1, row)
        direction = gradient[at, across]
        steep = np.abs(direction[:, 1 - axis]) > np.abs(direction[:, axis])
        steep &= coherence[at, across] > _MIN_COHERENCE
        half = np.array([0.5, 0.0] if axis else [0.0, 0.5])
        place = np.column_stack([across, at]) + half
        found.append((place[steep], direction[steep], near[steep]))
    place, direction, near = (np.concatenate(each) for each in zip(*found, strict=True))
    normal = -direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return place[:, 1], place[:, 0], normal, near


def _directions(nearness: Float) -> tuple[Float, Float]:
    """Gradient (H, W, 2) of the smoothed nearness, x and y, and its coherence (H, W).

    The coherence of the structure tensor is 1 where all gradients nearby are parallel (Bigun and
    Granlund 1987, Optimal orientation detection of linear symmetry).
    """
    smooth = cv2.GaussianBlur(nearness, (0, 0), _NORMAL_SIGMA_PX)
    x, y = cv2.Scharr(smooth, cv2.CV_32F, 1, 0), cv2.Scharr(smooth, cv2.CV_32F, 0, 1)
    xx, yy, xy = (
        cv2.GaussianBlur(product, (0, 0), _COHERENCE_SIGMA_PX) for product in (x * x, y * y, x * y)
    )
    coherence = np.hypot(xx - yy, 2 * xy) / np.maximum(xx + yy, 1e-12)
    return np.dstack([x, y]), coherence


def _profiles(image: UInt8, xy: Float, normal: Float, reach: int) -> Float:
    """(N, 2 reach + 1) size of the colour's gradient along the normals, relative to its mean."""
    if not len(xy):
        return np.zeros((0, 2 * reach + 1), np.float32)
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _COLOUR_SIGMA_PX)
    offsets = np.arange(-reach, reach + 1)
    # Differences of neighbouring samples: the gradient between them.
    between = np.arange(-reach - 0.5, reach + 1)
    x, y = (
        (xy[:, axis, None] + normal[:, axis, None] * between).astype(np.float32) for axis in (0, 1)
    )
    # Linear interpolation would smooth the picture's noise least at the edge itself, where samples
    # are near pixel centres, and so make a peak there.
    samples = cv2.remap(smooth, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    size = np.abs(np.diff(samples.reshape(len(xy), len(between), -1), axis=1)).max(axis=2)
    size = size.reshape(len(xy), len(offsets))
    relative = size / (size.mean(axis=1, keepdims=True) + _NOISE)
    return np.asarray(np.minimum(relative, _HIGHEST_PEAK), np.float32)
