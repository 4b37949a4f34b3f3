"""Compare the depth across masks with that of one stem, and of two of which one hides the other.

Across its axis a stem is round or oval. Between the rays that touch it, the front of any ellipse
has the depth `c + a u - b sqrt(1 - u²)`, where u is -1 and 1 at its edges: an affine map turns a
circle into an ellipse and keeps its tangents. It is linear in c, a and b, so each shape is fitted
by least squares, with the ovality of stems as a prior on a and b.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from basetree.arrays import Bool, Float, Index
from basetree.normal import MAD_TO_STD
from calib.directions import unit
from edgetree.measure.constants.depth import (
    BARK_STD_M,
    MIN_GAIN,
    NOISE_PRIOR_READINGS,
    OUTLIER_STDS,
    OVAL_DEPTH_STD,
    OVAL_TURN_STD,
    SHAPE_STD,
    SURFACE_M,
    SURFACE_STDS,
)
from edgetree.measure.edge_lines import masked_medians
from edgetree.measure.frame import MASK_THRESHOLD, DepthFrame
from edgetree.measure.outline import Outline
from edgetree.measure.regions import STATIONS

PARTS = 6
"""Neighbouring stations are taken together in so many parts of the stem."""

# Places across the mask, and how many of them each of two stems needs. The one next to the step
# between both may mix them.
_SAMPLES, _MIN_SAMPLES = 24, 4
_ACROSS = (np.arange(_SAMPLES) + 0.5) * 2 / _SAMPLES - 1
# Beyond the first of these a pixel may mix stem and background. Beside the mask, the depth
# is read at the second.
_WITHIN, _BESIDE = 0.94, 1.3
# A place needs readings at so many of a part's stations, and all parts together so many parts.
_MIN_STATIONS, _MIN_TOGETHER = 2, 4
# Single places that differ from most of so many around them are left out.
_AROUND = 5
_MEDIAN_VARIANCE = np.pi / 2
_PRIOR = np.diag([1e-6, OVAL_TURN_STD**-2, OVAL_DEPTH_STD**-2])
_PRIOR_RIGHT = np.array([0.0, 0.0, OVAL_DEPTH_STD**-2])


class AcrossMasks(NamedTuple):
    """What shows across the masks of T stems, in P parts along each, from low to high.

    Places across are in half widths of the mask there: -1 and 1 at its edges.

    Attributes:
        seen: (T, P) whether both edges of the mask show.
        two: (T, P) whether the depth is that of two stems and not that of one.
        near: (T, P, 2) left and right edge of the nearer of two, else -1 and 1.
        behind: (T, P) how far the axis of the other one is behind its axis, in its radii.
        parted: (T, P) whether the background shows between two surfaces that are as far away.
        depth_m: (T, P, N) distance at N even places across, along the view of the stem; 0 where
            it is not known.
        filled: (T, P, N) which of these places are on the mask.
        middle_px, half_px: (T, P) middle of the mask across the search region, and half its width.
    """

    seen: Bool
    two: Bool
    near: Float
    behind: Float
    parted: Bool
    depth_m: Float
    filled: Bool
    middle_px: Float
    half_px: Float


@dataclass(frozen=True, eq=False)
class _Profiles:
    """Depth across the parts of stems.

    Attributes:
        depth_m: (T, P, N) distance along the view.
        readings: (T, P, N) number of readings behind it.
        scatter_m: (T, P) standard deviation of one of them.
        half_px: (T, P) half the width of the mask.
    """

    depth_m: Float
    readings: Float
    scatter_m: Float
    half_px: Float

    @cached_property
    def level_m(self) -> Float:
        """(T, P) median depth."""
        return masked_medians(self.depth_m, self.readings > 0)

    def together(self) -> _Profiles:
        """The same (T, 1) of whole stems: medians of their parts, each less its own depth."""
        used = self.readings > 0
        level_m, known = self.level_m, np.asarray(used.any(2))
        off_m = masked_medians(
            np.moveaxis(self.depth_m - level_m[..., None], 1, 2), np.moveaxis(used, 1, 2)
        )
        number = self.readings.sum(1) * (used.sum(1) >= _MIN_TOGETHER) / _MEDIAN_VARIANCE
        middles = (
            masked_medians(each, known)[:, None] for each in (level_m, self.scatter_m, self.half_px)
        )
        middle_m, *others = middles
        return _Profiles(off_m[:, None] + middle_m[..., None], number[:, None], *others)


def look_across(frame: DepthFrame, outline: Outline) -> AcrossMasks:
    """Compare the depth across masks with one stem and with two.

    Each part along a stem is compared by itself, as two stems may lean apart. Where no part tells,
    all together may: then both stems have the same place in all of them. What goes on beside the
    mask is brush or netting, and no nearer stem.

    Args:
        frame: Depth, masks and settings.
        outline: Edges in the masks.
    """
    regions = outline.regions
    left, right = outline.edges_px
    middle, half = (left + right) / 2, (right - left) / 2
    found = (outline.found.all(0) & (half > 1))[..., None]
    places = np.concatenate([[-_BESIDE], _ACROSS, [_BESIDE]])
    across_px = middle[..., None] + half[..., None] * places
    shift_px = outline.depth_shift_px[:, None, None]
    read_m = _ahead_m(
        frame, regions.points(across_px + shift_px), regions.points(middle[..., None])
    )
    inside = frame.mask_probability(regions.points(across_px[..., 1:-1])) >= MASK_THRESHOLD
    # Smoothed depth near an edge is a mixture with the background.
    clear = 1 - outline.depth_ramp_px / 2 / np.maximum(half[..., None], 1e-3)
    usable = found & inside & (np.abs(_ACROSS) <= np.minimum(clear, _WITHIN))
    stations = _parts(found).sum(3)
    filled = 2 * _parts(inside & found).sum(3) > stations
    middle_px, half_px = (
        masked_medians(_parts(each[..., None]), _parts(found))[..., 0] for each in (middle, half)
    )
    profiles = _profiles(_parts(np.where(usable, read_m[..., 1:-1], 0.0)), filled, half_px)
    station_px = (regions.span_px[:, 1] - regions.span_px[:, 0]) / STATIONS
    told = _tell(frame, profiles, station_px)
    whole = _tell(frame, profiles.together(), station_px)
    two, near, behind = told
    untold = ~two.any(1) & whole[0][:, 0]
    for part, all_of_it in zip(told, whole, strict=True):
        part[untold] = all_of_it[untold]
    beside_m = _parts(np.where(found, read_m[..., [0, -1]], 0.0))
    beside_m = masked_medians(beside_m, beside_m > 0)
    two &= (stations[..., 0] >= _MIN_STATIONS) & ~_goes_on(frame, profiles, near, beside_m)
    near[~two] = -1.0, 1.0
    behind_m = _parts(np.where(found, read_m[..., 1:-1], 0.0))
    known = profiles.readings > 0
    return AcrossMasks(
        seen=stations[..., 0] >= _MIN_STATIONS,
        two=two,
        near=near,
        behind=behind,
        parted=_parted(frame, profiles, behind_m, filled, beside_m),
        depth_m=np.where(known, profiles.depth_m, 0.0),
        filled=filled,
        middle_px=middle_px,
        half_px=half_px,
    )


def _profiles(parts_m: Float, filled: Bool, half_px: Float) -> _Profiles:
    """Medians of readings (T, P, N, S) over the stations of each part."""
    readings = np.where(filled, (parts_m > 0).sum(3), 0)
    readings[readings < _MIN_STATIONS] = 0
    depth_m = masked_medians(parts_m, parts_m > 0)
    off_m = masked_medians(np.abs(parts_m - depth_m[..., None]), parts_m > 0)
    scatter_m = MAD_TO_STD * masked_medians(off_m, readings > 0)
    sides = ((0, 0), (0, 0), (_AROUND // 2, _AROUND // 2))
    around_m = sliding_window_view(np.pad(np.where(readings > 0, depth_m, 0), sides), _AROUND, 2)
    return _Profiles(masked_medians(around_m, around_m > 0), readings, scatter_m, half_px)


def _ahead_m(frame: DepthFrame, xy_px: Float, middle_px: Float) -> Float:
    """Distances (T, S, N) of readings along the view of the stem.

    In depth along the optical axis, stems beside that axis look nearer on one side.

    Args:
        frame: Depth and camera.
        xy_px: (T, S, N, 2) places of the readings.
        middle_px: (T, S, 1, 2) middles of the stems.
    """
    rays, depth_m = frame.readings(xy_px)
    return np.asarray(np.vecdot(rays, unit(frame.rays(middle_px))) * depth_m)


def _noise_m(frame: DepthFrame, profiles: _Profiles) -> Float:
    """(T, P) standard deviation of a reading: the assumed one, adjusted to the scatter.

    The assumed one counts as `NOISE_PRIOR_READINGS` readings.
    """
    assumed_m = frame.settings.depth_stds_m(profiles.level_m)
    number = (profiles.readings > 0).sum(2)
    squares = NOISE_PRIOR_READINGS * assumed_m**2 + number * profiles.scatter_m**2
    return np.asarray(np.sqrt(squares / (NOISE_PRIOR_READINGS + number)))


def _goes_on(frame: DepthFrame, profiles: _Profiles, near: Float, beside_m: Float) -> Bool:
    """(T, P) whether the nearer of two goes on beside the mask.

    Args:
        frame: Settings.
        profiles: Depth across the stems.
        near: (T, P, 2) edges of the nearer one.
        beside_m: (T, P, 2) depth to the left and to the right of the mask; 0 where there is none.
    """
    on_left = near[..., :1] == -1
    beside_m = np.where(on_left, beside_m[..., :1], beside_m[..., 1:])[..., 0]
    own = (near[..., :1] < _ACROSS) & (near[..., 1:] > _ACROSS) & (profiles.readings > 0)
    own_m = masked_medians(profiles.depth_m, own)
    within_m = SURFACE_STDS * _noise_m(frame, profiles) + SURFACE_M
    return np.asarray((beside_m > 0) & (np.abs(beside_m - own_m) < within_m))


def _parted(
    frame: DepthFrame, profiles: _Profiles, parts_m: Float, filled: Bool, beside_m: Float
) -> Bool:
    """(T, P) whether the background shows between two surfaces: nothing is seen through a stem.

    It is further away, or the mask has a gap without a reading, as of the sky. Surfaces that go on
    beside the mask, such as wires of netting, are no stems.

    Args:
        frame: Camera and settings.
        profiles: Depth across the stems.
        parts_m: (T, P, N, S) all readings, on the mask or not; 0 where there is none.
        filled: (T, P, N) places on the mask.
        beside_m: (T, P, 2) depth to the left and to the right of the mask; 0 where there is none.
    """
    within_m = SURFACE_STDS * _noise_m(frame, profiles) + SURFACE_M
    reach_m = profiles.half_px * profiles.level_m / frame.camera.fx + within_m
    off_m = parts_m - profiles.level_m[..., None, None]
    most = parts_m.shape[-1] / 2
    reach_m = reach_m[..., None, None]
    far = (off_m > reach_m).sum(3) > most
    near = ((parts_m > 0) & (off_m <= reach_m)).sum(3)
    own = filled & (near > most)
    far |= ~filled & (near < most)
    left = own.cumsum(2)
    right = left[..., -1:] - left
    between = (far & (left >= _MIN_SAMPLES) & (right >= _MIN_SAMPLES)).any(2)
    alike = (beside_m > 0) & (np.abs(beside_m - profiles.level_m[..., None]) < within_m[..., None])
    return np.asarray(between & ~alike.any(2))


def _tell(frame: DepthFrame, profiles: _Profiles, station_px: Float) -> tuple[Bool, Float, Float]:
    """`two`, `near` and `behind` of `AcrossMasks`.

    Two stems explain the depth if they lower the sum of squares by `MIN_GAIN` and by more than
    half. Readings count as independent at distances of `MeasureSettings.depth_correlation_px`, and
    are off by noise, bark (`BARK_STD_M`) and shape (`SHAPE_STD`).

    Args:
        frame: Camera and settings.
        profiles: Depth across the stems.
        station_px: (T,) distance of the stations.
    """
    radius_m = np.maximum(profiles.half_px * profiles.level_m / frame.camera.fx, 1e-3)
    correlation_px = frame.settings.depth_correlation_px
    along = np.maximum(correlation_px / np.maximum(station_px, 1e-3), 1.0)[:, None, None]
    across = correlation_px * _SAMPLES / np.maximum(2 * profiles.half_px, 1e-3)
    number = np.maximum(profiles.readings / along, 1.0)
    shape_m = np.hypot(SHAPE_STD * radius_m, BARK_STD_M)[..., None]
    variance = shape_m**2 + _noise_m(frame, profiles)[..., None] ** 2 / number
    variance *= np.maximum(across, 1.0)[..., None]
    weight = np.where(profiles.readings > 0, radius_m[..., None] ** 2 / variance, 0.0)
    return _compared(profiles.depth_m / radius_m[..., None], weight)


def _compared(depth: Float, weight: Float) -> tuple[Bool, Float, Float]:
    """The same from depths (T, P, N) in half widths of the mask and their weights."""
    shape = depth.shape[:2]
    misfit = _fit(depth.reshape(-1, _SAMPLES), weight.reshape(-1, _SAMPLES), _ONE)[0]
    misfit = misfit.reshape(shape)
    two, behind = np.zeros(shape, np.bool_), np.zeros(shape)
    near = np.tile([-1.0, 1.0], (*shape, 1))
    rows = np.nonzero(((weight > 0).sum(2) >= 2 * _MIN_SAMPLES) & (misfit > MIN_GAIN))
    if len(rows[0]):
        left, step, gap = _two_stems(depth[rows], weight[rows])
        right, mirrored, other_gap = _two_stems(depth[rows][:, ::-1], weight[rows][:, ::-1])
        is_left = left <= right
        gain = misfit[rows] - np.minimum(left, right)
        two[rows] = (gain > MIN_GAIN) & (gain > misfit[rows] / 2)
        low, high = np.where(is_left, -1.0, -mirrored), np.where(is_left, step, 1.0)
        near[rows] = np.stack([low, high], 1)
        behind[rows] = np.where(is_left, gap, other_gap)
    return two, near, behind


def _parts(values: NDArray[Any]) -> NDArray[Any]:
    """(T, P, N, S / P) values (T, S, N) in parts of the stem."""
    count, _, samples = values.shape
    return values.reshape(count, PARTS, -1, samples).swapaxes(2, 3)


class _Shapes(NamedTuple):
    """K ellipses: (K, N, 3) factors of c, a and b, and (K, N) places that belong to each."""

    basis: Float
    used: Bool


def _ellipses(low: Float, high: Float, used: Bool) -> _Shapes:
    """Ellipses between edges (K,); a and b are in the depth of a circle."""
    half = ((high - low) / 2)[:, None]
    place = np.clip((_ACROSS - (low + high)[:, None] / 2) / half, -1.0, 1.0)
    basis = np.stack([np.ones_like(place), half * place, -half * np.sqrt(1 - place**2)], -1)
    return _Shapes(basis, used)


def _fit(depth: Float, weight: Float, shapes: _Shapes) -> tuple[Float, Float]:
    """Fit K shapes to M depths (M, N); squares (M, K) that they leave, and (M, K) values of c.

    Squares above `OUTLIER_STDS`² count as that.
    """
    basis, used = shapes
    own = basis * used[..., None]
    count, samples = len(own), depth.shape[1]
    pairs = (own[..., None] * basis[..., None, :]).swapaxes(0, 1).reshape(samples, -1)
    normal = (weight @ pairs).reshape(-1, count, 3, 3) + _PRIOR
    right = ((weight * depth) @ own.swapaxes(0, 1).reshape(samples, -1)).reshape(-1, count, 3)
    found = np.linalg.solve(normal, (right + _PRIOR_RIGHT)[..., None])[..., 0]
    off = depth[:, None] - np.matmul(basis, found[..., None])[..., 0]
    squares = np.minimum(weight[:, None] * off**2, OUTLIER_STDS**2) * used
    prior = (found[..., 1] / OVAL_TURN_STD) ** 2 + ((found[..., 2] - 1) / OVAL_DEPTH_STD) ** 2
    return squares.sum(2) + prior, found[..., 0]


def _two_stems(depth: Float, weight: Float) -> tuple[Float, Float, Float]:
    """The best of two stems, the left one nearer, for M depths (M, N).

    Returns:
        (M,) squares that they leave, the step between them, and how far the right one's axis is
        behind the left one's, in radii of the left one.
    """
    near_misfit, near = _fit(depth, weight, _NEAR)
    far_misfit, far = _fit(depth, weight, _FAR)
    behind = (far - near) / ((1 + _STEPS) / 2)
    misfit = np.where(behind > 0, near_misfit + far_misfit, np.inf)
    best: Index = misfit.argmin(1)
    rows = np.arange(len(depth))
    return misfit[rows, best], _STEPS[best], behind[rows, best]


_STEPS = _ACROSS[_MIN_SAMPLES : -_MIN_SAMPLES + 1] - 1 / _SAMPLES
_NUMBER = np.arange(_MIN_SAMPLES, _SAMPLES - _MIN_SAMPLES + 1)[:, None]
_ONE = _ellipses(-np.ones(1), np.ones(1), np.ones((1, _SAMPLES), np.bool_))
_NEAR = _ellipses(-np.ones_like(_STEPS), _STEPS, np.arange(_SAMPLES) < _NUMBER - 1)
# The further one shows in part: it is taken to be as thick as the nearer one, or as what shows.
_FAR = _ellipses(
    1 - np.maximum(1 - _STEPS, 1 + _STEPS), np.ones_like(_STEPS), np.arange(_SAMPLES) >= _NUMBER
)
