"""Find the ground around the bases of stems."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from basetree.arrays import Bool, Float
from calib import GroundPlane, GroundPlaneFailure, fit_ground_planes
from edgetree.measure.base_ground import BaseGround, DistrustedGround, StemBases, UnseenGround
from edgetree.measure.constants.depth import SURFACE_M
from edgetree.measure.constants.ground import (
    DEPARTURE_STD_PER_M,
    FOOT_STDS,
    GAP_STDS,
    GAP_WITHIN_M,
    LITTER_STD_M,
    MAX_ABOVE_STEM_M,
    MAX_SLOPE_WITHOUT_FOOT_DEG,
    MIN_ABOVE_UNSEEN_FOOT_M,
    MIN_GAP_READINGS,
    MIN_SHARE_WITHOUT_FOOT,
    OWN_RADII,
    POINTS_PER_ERROR,
    SEARCH_RADIUS_M,
    UNEVEN_STD_M,
)
from edgetree.measure.constants.outlines import NEAR_RAD
from edgetree.measure.estimates import Estimate, Failure
from edgetree.measure.frame import DepthFrame
from edgetree.measure.ground_cover import cover_stds_m, gap_depth_m
from edgetree.measure.ground_samples import Axes, GroundSamples, sample_around, thinned
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.vertical import Verticals

# Rows and columns of the sampling grid. The second one is for sparse depth.
_GRIDS = (27, 72)
# Fewer points make no plane.
_MIN_POINTS = 20
# Where no stem has more, nothing but stems is seen: `fit_ground_planes` makes no plane of fewer.
_FEW_POINTS = 12
_NO_WIDER = (
    "no ground around the base: the foot of the stem is not in the image, and what is seen beside"
    " the stem is no wider than the stem, as its own bark or roots"
)


def find_grounds(
    frame: DepthFrame, bases: StemBases, verticals: Verticals, noise: float
) -> list[BaseGround | Failure]:
    """Fit the ground around each stem.

    1. Sample the depth on a grid around each cut or foot, leaving out the stems.
    2. Fit the lowest plane that many of these points support; points count less with their
       distance from the bark, as ground is not flat.
    3. Judge by the surface, its gaps and the stem's foot how far plants may hide the ground.
    4. Take the vertical at the stem, and refuse planes above the stem's seen part or of branches.
    5. Where the depth is sparse and shows too little, repeat with the finer grid.

    Args:
        frame: Depth, camera and masks.
        bases: The lower ends of T stems.
        verticals: The verticals of all stems of the frame.
        noise: Ratio of the noise of the depth to the assumed one.

    Returns:
        T grounds, or why there is none.
    """
    up = verticals.common
    grounds: list[BaseGround | Failure] = [Failure("no ground around the base")] * len(bases.cuts)
    missing = np.arange(len(bases.cuts))
    stated = Estimate(frame.settings.ground_cover_m, frame.settings.ground_cover_std_m)
    for grid in _GRIDS:
        radius_m, cuts = bases.radii_m[missing], bases.cuts[missing]
        # Around a foot the ground meets the bark, so nothing is left out there.
        own_m = np.where(bases.foot_within, 0.0, OWN_RADII * bases.radii_m + SURFACE_M)[missing]
        axes = Axes(cuts, bases.along[missing], own_m)
        samples = sample_around(frame, axes, SEARCH_RADIUS_M + radius_m, up, grid)
        planes = _fit_planes(frame, samples, radius_m, up, noise)
        few = samples.usable.sum(1) < _FEW_POINTS
        own = _may_be_own(samples, radius_m, cuts, up, ~bases.foot_within[missing])
        for index, found, unseen, narrow in zip(missing, planes, few, own, strict=True):
            if isinstance(found, Failure):
                grounds[index] = UnseenGround(found.reason) if unseen or narrow else found
            elif narrow:
                grounds[index] = UnseenGround(_NO_WIDER)
            else:
                vertical = verticals.at(int(bases.indices[index]), found[0].normal)
                ground = BaseGround(found[0], vertical, found[1], stated)
                grounds[index] = _if_trusted(ground, bases, int(index))
        missing = missing[samples.sparse & (samples.usable.sum(1) < _MIN_POINTS)]
        if not len(missing):
            break
    return grounds


def _may_be_own(
    samples: GroundSamples, radii_m: Float, cuts: Float, up: Float, asked: Bool
) -> Bool:
    """(T,) of those asked, near stems beside which no more shows than their own bark and roots."""
    own: Bool = asked & (2 * radii_m > NEAR_RAD * np.linalg.norm(cuts, axis=1))
    if not own.any():
        return own
    points, usable = samples.points[own], samples.usable[own][..., None]
    level = points - (points @ up)[..., None] * up
    count = np.maximum(usable.sum(1, keepdims=True), 1)
    off_m = np.where(usable, level - np.where(usable, level, 0.0).sum(1, keepdims=True) / count, 0)
    squares = np.linalg.eigvalsh(off_m.swapaxes(1, 2) @ off_m / count)[:, -1]
    own[own] = squares < (OWN_RADII * radii_m[own]) ** 2
    return own


def _if_trusted(ground: BaseGround, bases: StemBases, index: int) -> BaseGround | Failure:
    """The ground, or why its plane is not that of the ground on which the stem stands."""
    plane = ground.plane
    lowest = bases.lowest[index]
    seen = all(map(math.isfinite, lowest.tolist()))
    below_m = -float(plane.height_m(lowest)) if seen else -math.inf
    if below_m > MAX_ABOVE_STEM_M + 2 * ground.uphill_m(float(bases.radii_m[index])):
        deeper = f"the stem is seen {below_m:.2f} m below the best plane"
        return DistrustedGround(f"no ground around the base: {deeper}", ground)
    ground = _as_deep_as_the_foot(ground, bases, index)
    if bases.foot_within[index]:
        return ground
    unseen_foot = "no ground around the base: the foot of the stem is not in the image, and"
    slope_deg = math.degrees(math.acos(min(float(plane.normal @ ground.up), 1.0)))
    if slope_deg > MAX_SLOPE_WITHOUT_FOOT_DEG or plane.inlier_fraction < MIN_SHARE_WITHOUT_FOOT:
        held = f"{plane.inlier_fraction:.0%} of the points and slopes by {slope_deg:.0f} degrees"
        return Failure(f"{unseen_foot} the best plane holds {held}")
    if ground.overgrown and -below_m < MIN_ABOVE_UNSEEN_FOOT_M:
        near = f"the best plane lies only {-below_m:.2f} m below what is seen of it"
        return Failure(f"{unseen_foot} {near}")
    return ground


def _as_deep_as_the_foot(ground: BaseGround, bases: StemBases, index: int) -> BaseGround:
    """The ground, in doubt if the mask shows bark below its plane."""
    foot = bases.feet[index]
    if not all(map(math.isfinite, foot.tolist())):
        return ground
    plane = ground.plane
    below_m = -float(plane.height_m(foot))
    if below_m < FOOT_STDS * UNEVEN_STD_M:
        return ground
    parts = (float(plane.height_std_m(foot)), float(bases.feet_std_m[index]), UNEVEN_STD_M)
    if below_m < FOOT_STDS * math.hypot(*parts, LITTER_STD_M):
        return ground
    return replace(ground, cover_std_m=max(ground.cover_std_m, below_m))


def _fit_planes(
    frame: DepthFrame, samples: GroundSamples, radii_m: Float, up: Float, noise: float
) -> list[tuple[GroundPlane, float] | Failure]:
    """Fit planes to samples around T stems of radii (T,).

    Returns:
        T planes with the standard deviations of their height because plants may hide the ground, or
        why there is none.
    """
    points, usable, level_m, _ = thinned(samples)
    settings = frame.settings
    depth_std_m = settings.depth_stds_m(points[..., 2])
    from_bark_m = np.maximum(level_m - radii_m[:, None], 0.0)
    planes = fit_ground_planes(
        points,
        usable,
        up,
        settings.max_slope_deg,
        3 * UNEVEN_STD_M,
        POINTS_PER_ERROR,
        depth_std_m,
        DEPARTURE_STD_PER_M * from_bark_m**2,
    )
    cover_std_m = cover_stds_m(frame, points, usable, noise * depth_std_m, planes)
    from_bark_m = np.maximum(samples.level_m - radii_m[:, None], 0.0)
    deep = samples.usable & (from_bark_m < GAP_WITHIN_M)
    deep &= _heights_m(samples.points, planes) < -GAP_STDS * UNEVEN_STD_M
    return [
        Failure(f"no ground around the base: {plane.reason}")
        if isinstance(plane, GroundPlaneFailure)
        else (plane, max(std_m, _gap_depth_m(settings, xyz[here], away_m[here], plane, noise)))
        for plane, std_m, xyz, away_m, here in zip(
            planes, cover_std_m.tolist(), samples.points, from_bark_m, deep, strict=True
        )
    ]


def _heights_m(points: Float, planes: Sequence[GroundPlane | GroundPlaneFailure]) -> Float:
    """(T, N) heights of points (T, N, 3) above their planes; 0 where there is none."""
    normals, offsets_m = np.zeros((len(planes), 3, 1)), np.zeros((len(planes), 1))
    for index, plane in enumerate(planes):
        if isinstance(plane, GroundPlane):
            normals[index, :, 0], offsets_m[index] = plane.normal, plane.offset_m
    return np.asarray(np.matmul(points, normals)[..., 0] + offsets_m)


def _gap_depth_m(
    settings: MeasureSettings,
    points: Float,
    from_bark_m: Float,
    plane: GroundPlane,
    noise: float,
) -> float:
    """How far below the plane of one stem deep samples beside it show the ground, in metres."""
    if len(points) < MIN_GAP_READINGS:
        return 0.0
    depth_m = points[:, 2]
    slope = np.abs(points @ plane.normal) / depth_m
    height_std_m = slope * noise * settings.depth_stds_m(depth_m)
    departure_m = DEPARTURE_STD_PER_M * from_bark_m**2
    std_m = np.sqrt(UNEVEN_STD_M**2 + height_std_m**2 + departure_m**2)
    return gap_depth_m(points, std_m, plane)
