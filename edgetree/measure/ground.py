"""Fit the ground around the bases of stems, and measure heights above it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from calib import GroundPlane, GroundPlaneFailure, fit_ground_planes
from edgetree.measure.constants.depth import SURFACE_M
from edgetree.measure.constants.ground import (
    DEPARTURE_STD_PER_M,
    FOOT_STDS,
    GAP_STDS,
    GAP_WITHIN_M,
    LIFT,
    LITTER_STD_M,
    MAX_ABOVE_STEM_M,
    MAX_COVER_STD_M,
    MAX_SLOPE_WITHOUT_FOOT_DEG,
    MIN_ABOVE_UNSEEN_FOOT_M,
    MIN_COVER_STD_M,
    MIN_GAP_READINGS,
    MIN_PLANTS_SHARE,
    MIN_SHARE_WITHOUT_FOOT,
    OUTLIER_STD_M,
    OWN_RADII,
    POINTS_PER_ERROR,
    SEARCH_RADIUS_M,
    UNEVEN_STD_M,
)
from edgetree.measure.constants.outlines import NEAR_RAD
from edgetree.measure.estimates import Estimate, Failure
from edgetree.measure.frame import DepthFrame
from edgetree.measure.ground_cover import cover_stds_m, depth_stds_m, gap_depth_m
from edgetree.measure.ground_samples import Axes, GroundSamples, sample_around, thinned
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.vertical import Vertical, Verticals

# Rows and columns of the sampling grid. The second one is for sparse depth.
_GRIDS = (27, 72)
# Fewer points make no plane.
_MIN_POINTS = 20
# Where no stem has more, nothing but stems is seen: `fit_ground_planes` makes no plane of fewer.
_FEW_POINTS = 12
# Smallest cosine of the angle between an axis and the ground's normal, or the vertical. It keeps
# lengths along a lying stem finite.
_MIN_COSINE = 0.2
_NO_COVER = Estimate(0.0, 0.0)
_NO_WIDER = (
    "no ground around the base: the foot of the stem is not in the image, and what is seen beside"
    " the stem is no wider than the stem, as its own bark or roots"
)


@dataclass(frozen=True, eq=False)
class BaseGround:
    """The ground plane at a stem, and the vertical along which heights are measured.

    Attributes:
        plane: Plane fitted to the depth around the base.
        vertical: The vertical at the stem.
        cover_std_m: Standard deviation of the ground's height because plants may hide it.
        stated_cover: Height of snow or plants that the settings state.
    """

    plane: GroundPlane
    vertical: Vertical
    cover_std_m: float = 0.0
    stated_cover: Estimate = _NO_COVER

    @property
    def up(self) -> Float:
        """(3,) unit vector away from gravity, in camera coordinates."""
        return self.vertical.up

    def turned(self, rotation: Float) -> BaseGround:
        """The same in other axes, by a rotation (3, 3) to them."""
        plane = replace(
            self.plane,
            normal=rotation @ self.plane.normal,
            centre_m=rotation @ self.plane.centre_m,
            axes=self.plane.axes @ rotation.T,
        )
        return replace(self, plane=plane, vertical=self.vertical.turned(rotation))

    @property
    def lift_m(self) -> float:
        """How far low plants are expected to lift the plane above the ground, in metres."""
        return LIFT * self.plane.residual_std_m * self.plane.above_fraction

    @property
    def below_plane_m(self) -> float:
        """How far the ground lies below the plane: `lift_m` and the stated cover."""
        return self.lift_m + self.stated_cover.value

    @property
    def overgrown(self) -> bool:
        """Whether plants hide a large part of the ground."""
        return self.plane.above_fraction > MIN_PLANTS_SHARE or self.cover_std_m > MIN_COVER_STD_M

    @property
    def hidden(self) -> bool:
        """Whether the surface is so unsteady that it is that of plants, and not the ground."""
        return self.cover_std_m > MAX_COVER_STD_M

    def height_m(
        self, axis_point: Float, along: Float, radius_m: float, axis_std_m: float
    ) -> Estimate | Failure:
        """Height of a point of the axis above the ground on the stem's uphill side.

        The axis is followed to the ground, which lies `below_plane_m` below the plane. On the
        uphill side of the stem the ground is higher by the radius times the tangent of its slope.

        Args:
            axis_point: (3,) camera point on the axis.
            along: (3,) unit vector up the axis.
            radius_m: Radius of the stem.
            axis_std_m: Standard deviation of the point's height.

        Returns:
            The height in metres along the vertical, or why there is none.
        """
        cosine = float(self.plane.normal @ along)
        if cosine < _MIN_COSINE:
            return Failure("the stem lies along the ground")
        length = (float(self.plane.height_m(axis_point)) + self.below_plane_m) / cosine
        foot = axis_point - length * along
        value = length * float(along @ self.up) - self.uphill_m(radius_m)
        plane_std_m = float(self.plane.height_std_m(foot))
        outlier_std_m = OUTLIER_STD_M * (1 - self.plane.inlier_fraction) ** 2
        # An error of the vertical changes the slope by as much.
        uphill_std_m = radius_m * self.vertical.tilt_std_rad
        cover_std_m = math.hypot(self.cover_std_m, self.stated_cover.std)
        parts = (plane_std_m, outlier_std_m, cover_std_m, uphill_std_m, LITTER_STD_M)
        return Estimate(value, math.hypot(*parts, axis_std_m))

    def cut_std_m(self, height_m: float, rise: float, distance_std_m: float, cut_m: float) -> float:
        """Standard deviation of a cut's height by the errors of its distance and direction.

        Args:
            height_m: Its height.
            rise: Metres that it rises per metre of its distance from the camera.
            distance_std_m: Standard deviation of the distance.
            cut_m: That of its place across the line of sight, up and down.
        """
        return math.hypot(rise * distance_std_m, cut_m)

    def axis_length_m(
        self, axis_point: Float, along: Float, radius_m: float, height_m: float
    ) -> float:
        """Distance along the axis from a point of it up to a height, the inverse of `height_m`.

        Args:
            axis_point: (3,) camera point on the axis.
            along: (3,) unit vector up the axis.
            radius_m: Radius of the stem.
            height_m: Height above the ground on the uphill side, along the vertical.
        """
        cosine = max(float(self.plane.normal @ along), _MIN_COSINE)
        foot_m = -(float(self.plane.height_m(axis_point)) + self.below_plane_m) / cosine
        return foot_m + (height_m + self.uphill_m(radius_m)) * self.axis_per_height(along)

    def axis_per_height(self, along: Float) -> float:
        """Metres along an axis of direction `along` (3,) per metre of height."""
        return 1 / max(float(along @ self.up), _MIN_COSINE)

    def uphill_m(self, radius_m: float) -> float:
        """Height of the ground on the stem's uphill side above that at its axis: r tan(slope)."""
        cos_slope = float(self.plane.normal @ self.up)
        return radius_m * math.sqrt(max(1 - cos_slope**2, 0.0)) / cos_slope

    def description(self) -> str:
        """The plane, and the direction along which heights are measured, as text."""
        residual_cm = 100 * self.plane.residual_std_m
        return (
            f"plane within {SEARCH_RADIUS_M} m of the stem, {self.plane.points} points"
            f" ({self.plane.inlier_fraction:.0%} there) ± {residual_cm:.1f} cm, heights along"
            f" {self.vertical.description()}{self._cover_description()}"
        )

    def _cover_description(self) -> str:
        if self.stated_cover.value > 0:
            height_m, std_m = self.stated_cover
            return f"; below a cover of {height_m:.2f} ± {std_m:.2f} m"
        if self.cover_std_m <= MIN_COVER_STD_M:
            return ""
        return f"; as unsteady as plants, which may hide the ground (± {self.cover_std_m:.2f} m)"


@dataclass(frozen=True)
class DistrustedGround(Failure):
    """Why a plane is not taken for the ground: bark is seen below it.

    Attributes:
        ground: The plane with the vertical. Depth that is too far away makes the same picture.
    """

    ground: BaseGround


@dataclass(frozen=True)
class UnseenGround(Failure):
    """Why there is no ground where hardly any depth but the stem's own is seen."""


class StemBases(NamedTuple):
    """The lower ends of T stems.

    Attributes:
        indices: (T,) numbers of the stems in the frame.
        cuts: (T, 3) camera points on the axes at the felling cuts.
        along: (T, 3) unit vectors of the axes.
        lowest: (T, 3) lowest camera points on the axes at which both edges show; not finite where
            they never do.
        radii_m: (T,) radii of the stems.
        foot_within: (T,) whether the foot is in the image, as far as one can tell.
        feet: (T, 3) lowest camera points at which the mask shows the bark; NaN without a mask.
        feet_std_m: (T,) standard deviations of their heights.
        feet_px: (T, 2) the same points in the image.
        feet_std_px: (T,) standard deviations of these, up and down.
    """

    indices: Index
    cuts: Float
    along: Float
    lowest: Float
    radii_m: Float
    foot_within: Bool
    feet: Float
    feet_std_m: Float
    feet_px: Float
    feet_std_px: Float

    def of(self, indices: Index | Bool) -> StemBases:
        """Those of some of the stems."""
        return StemBases._make(part[indices] for part in self)


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
    depth_std_m = depth_stds_m(settings, points[..., 2])
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
    near = samples.usable & (from_bark_m < GAP_WITHIN_M)
    return [
        Failure(f"no ground around the base: {plane.reason}")
        if isinstance(plane, GroundPlaneFailure)
        else (plane, max(std_m, _gap_depth_m(settings, xyz[here], away_m[here], plane, noise)))
        for plane, std_m, xyz, away_m, here in zip(
            planes, cover_std_m.tolist(), samples.points, from_bark_m, near, strict=True
        )
    ]


def _gap_depth_m(
    settings: MeasureSettings,
    points: Float,
    from_bark_m: Float,
    plane: GroundPlane,
    noise: float,
) -> float:
    """How far below the plane of one stem the samples beside it show deeper ground, in metres."""
    below = plane.height_m(points) < -GAP_STDS * UNEVEN_STD_M
    if np.count_nonzero(below) < MIN_GAP_READINGS:
        return 0.0
    points = points[below]
    depth_m = points[:, 2]
    slope = np.abs(points @ plane.normal) / depth_m
    height_std_m = slope * noise * depth_stds_m(settings, depth_m)
    departure_m = DEPARTURE_STD_PER_M * from_bark_m[below] ** 2
    std_m = np.sqrt(UNEVEN_STD_M**2 + height_std_m**2 + departure_m**2)
    return gap_depth_m(points, std_m, plane)
