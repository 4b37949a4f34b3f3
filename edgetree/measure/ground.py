"""Fit the ground around the bases of stems, and measure heights above it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib import GroundPlane, GroundPlaneFailure, fit_ground_planes
from edgetree.measure.estimates import Estimate, Failure
from edgetree.measure.frame import DepthFrame
from edgetree.measure.ground_cover import UNEVEN_STD_M, cover_stds_m, depth_stds_m
from edgetree.measure.ground_samples import GroundSamples, sample_around, thinned
from edgetree.measure.vertical import Vertical, Verticals

__all__ = ["BaseGround", "StemBases", "find_grounds"]

Float = NDArray[np.floating[Any]]

# Ground is searched for within this distance around the stem.
_SEARCH_RADIUS_M = 1.4
# Ground is not flat. Standard deviation by which it leaves the plane at the stem, by the squared
# distance from the bark. Chosen on 510 simulated frames with exact outlines.
_DEPARTURE_STD_PER_M = 0.15
# Rows and columns of the sampling grid. The second one is for sparse depth.
_GRIDS = (27, 72)
_MIN_POINTS = 20
_TOLERANCE_M = 3 * UNEVEN_STD_M
# Smallest standard deviation of the ground's height: litter, moss and roots.
_LITTER_STD_M = 0.02
_POINTS_PER_ERROR = 12.0
# Points off the plane may mean that plants hide the ground. Standard deviation of the height, times
# the squared fraction of such points.
_OUTLIER_STD_M = 0.15
# From this fraction of points above the plane on, plants hide the ground.
_MIN_PLANTS = 0.3
# The same from the first standard deviation because of plants on. From the second one on, the
# height of the ground is not known: a 95 % interval would be 0.8 m wide.
_MIN_COVER_STD_M, _MAX_COVER_STD_M = 0.08, 0.2
# Low plants pass for ground and lift the plane. It lies above the ground by this much of the spread
# of its points, times the share of points above it. Fitted on 791 simulated frames.
_LIFT = 0.35
# The ground lies above no seen part of the stem, but for this much and for its slope across it.
_MAX_ABOVE_STEM_M = 0.05
# Where the foot of the stem is below the image, branches are the lowest that is seen of many stems.
# So the plane is to hold this share of the points, and to be flatter than this.
_MIN_SHARE_WITHOUT_FOOT, _MAX_SLOPE_WITHOUT_FOOT_DEG = 0.3, 30.0
# Smallest cosine of the angle between an axis and the ground's normal, or the vertical.
_MIN_COSINE = 0.2


@dataclass(frozen=True, eq=False)
class BaseGround:
    """The ground plane at a stem, and the vertical along which heights are measured.

    Attributes:
        plane: plane fitted to the depth around the base.
        vertical: the vertical at the stem.
        cover_std_m: standard deviation of the ground's height because plants may hide it.
    """

    plane: GroundPlane
    vertical: Vertical
    cover_std_m: float = 0.0

    @property
    def up(self) -> Float:
        """(3,) unit vector away from gravity, in camera coordinates."""
        return self.vertical.up

    @property
    def lift_m(self) -> float:
        """How far low plants are expected to lift the plane above the ground, in metres."""
        return _LIFT * self.plane.residual_std_m * self.plane.above_fraction

    @property
    def overgrown(self) -> bool:
        """Whether plants hide a large part of the ground."""
        return self.plane.above_fraction > _MIN_PLANTS or self.cover_std_m > _MIN_COVER_STD_M

    @property
    def hidden(self) -> bool:
        """Whether the surface is so unsteady that it is that of plants, and not the ground."""
        return self.cover_std_m > _MAX_COVER_STD_M

    def height_m(
        self, axis_point: Float, along: Float, radius_m: float, axis_std_m: float
    ) -> Estimate | Failure:
        """Height of a point of the axis above the ground on the stem's uphill side.

        The axis is followed to the ground, which lies `lift_m` below the plane. On the uphill side
        of the stem the ground is higher by the radius times the tangent of its slope.

        Args:
            axis_point: (3,) camera point on the axis.
            along: (3,) unit vector up the axis.
            radius_m: radius of the stem.
            axis_std_m: standard deviation of the point's height.

        Returns:
            The height in metres along the vertical, or why there is none.
        """
        cosine = float(self.plane.normal @ along)
        if cosine < _MIN_COSINE:
            return Failure("the stem lies along the ground")
        length = (float(self.plane.height_m(axis_point)) + self.lift_m) / cosine
        foot = axis_point - length * along
        value = length * float(along @ self.up) - self.uphill_m(radius_m)
        plane_std_m = float(self.plane.height_std_m(foot))
        outlier_std_m = _OUTLIER_STD_M * (1 - self.plane.inlier_fraction) ** 2
        # An error of the vertical changes the slope by as much.
        uphill_std_m = radius_m * self.vertical.tilt_std_rad
        parts = (plane_std_m, outlier_std_m, self.cover_std_m, uphill_std_m, _LITTER_STD_M)
        return Estimate(value, math.hypot(*parts, axis_std_m))

    def axis_length_m(
        self, axis_point: Float, along: Float, radius_m: float, height_m: float
    ) -> float:
        """Distance along the axis from a point of it up to a height, the inverse of `height_m`.

        Args:
            axis_point: (3,) camera point on the axis.
            along: (3,) unit vector up the axis.
            radius_m: radius of the stem.
            height_m: height above the ground on the uphill side, along the vertical.
        """
        cosine = max(float(self.plane.normal @ along), _MIN_COSINE)
        foot_m = -(float(self.plane.height_m(axis_point)) + self.lift_m) / cosine
        up_cosine = max(float(along @ self.up), _MIN_COSINE)
        return foot_m + (height_m + self.uphill_m(radius_m)) / up_cosine

    def uphill_m(self, radius_m: float) -> float:
        """Height of the ground on the stem's uphill side above that at its axis: r tan(slope)."""
        cos_slope = float(self.plane.normal @ self.up)
        return radius_m * math.sqrt(max(1 - cos_slope**2, 0.0)) / cos_slope

    def description(self) -> str:
        """The plane, and the direction along which heights are measured, as text."""
        residual_cm = 100 * self.plane.residual_std_m
        return (
            f"plane within {_SEARCH_RADIUS_M} m of the stem, {self.plane.points} points"
            f" ({self.plane.inlier_fraction:.0%} there) ± {residual_cm:.1f} cm, heights along"
            f" {self.vertical.description()}{self._cover_description()}"
        )

    def _cover_description(self) -> str:
        if self.cover_std_m <= _MIN_COVER_STD_M:
            return ""
        return f"; as unsteady as plants, which may hide the ground (± {self.cover_std_m:.2f} m)"


class StemBases(NamedTuple):
    """The lower ends of T stems.

    Attributes:
        indices: (T,) numbers of the stems in the frame.
        cuts: (T, 3) camera points on the axes at the felling cuts.
        lowest: (T, 3) lowest camera points on the axes at which both edges show; not finite where
            they never do.
        radii_m: (T,) radii of the stems.
        foot_within: (T,) whether the foot is in the image, as far as one can tell.
    """

    indices: NDArray[np.intp]
    cuts: Float
    lowest: Float
    radii_m: Float
    foot_within: NDArray[np.bool_]


def find_grounds(
    frame: DepthFrame, bases: StemBases, verticals: Verticals, noise: float
) -> list[BaseGround | Failure]:
    """Fit the ground around each stem.

    Args:
        frame: depth, camera and masks.
        bases: the lower ends of T stems.
        verticals: the verticals of all stems of the frame.
        noise: ratio of the noise of the depth to the assumed one.

    Returns:
        T grounds, or why there is none.
    """
    up = verticals.common
    grounds: list[BaseGround | Failure] = [Failure("no ground around the base")] * len(bases.cuts)
    missing = np.arange(len(bases.cuts))
    for grid in _GRIDS:
        radius_m, cuts = bases.radii_m[missing], bases.cuts[missing]
        samples = sample_around(frame, cuts, _SEARCH_RADIUS_M + radius_m, up, grid)
        planes = _fit_planes(frame, samples, radius_m, up, noise)
        for index, found in zip(missing, planes, strict=True):
            if isinstance(found, Failure):
                grounds[index] = found
            else:
                vertical = verticals.at(int(bases.indices[index]), found[0].normal)
                ground = BaseGround(found[0], vertical, found[1])
                grounds[index] = _if_trusted(ground, bases, int(index))
        missing = missing[samples.sparse & (samples.usable.sum(1) < _MIN_POINTS)]
        if not len(missing):
            break
    return grounds


def _if_trusted(ground: BaseGround, bases: StemBases, index: int) -> BaseGround | Failure:
    """The ground, or why its plane is not that of the ground on which the stem stands."""
    plane = ground.plane
    lowest = bases.lowest[index]
    below_m = -float(plane.height_m(lowest)) if np.isfinite(lowest).all() else 0.0
    if below_m > _MAX_ABOVE_STEM_M + 2 * ground.uphill_m(float(bases.radii_m[index])):
        seen = f"the stem is seen {below_m:.2f} m below the best plane"
        return Failure(f"no ground around the base: {seen}")
    if bases.foot_within[index]:
        return ground
    slope_deg = math.degrees(math.acos(min(float(plane.normal @ ground.up), 1.0)))
    steep = slope_deg > _MAX_SLOPE_WITHOUT_FOOT_DEG
    if not steep and plane.inlier_fraction >= _MIN_SHARE_WITHOUT_FOOT:
        return ground
    return Failure(
        "no ground around the base: the foot of the stem is not in the image, and the best plane"
        f" holds {plane.inlier_fraction:.0%} of the points and slopes by {slope_deg:.0f} degrees"
    )


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
        _TOLERANCE_M,
        _POINTS_PER_ERROR,
        depth_std_m,
        _DEPARTURE_STD_PER_M * from_bark_m**2,
    )
    cover_std_m = cover_stds_m(frame, points, usable, noise * depth_std_m, planes)
    return [
        Failure(f"no ground around the base: {plane.reason}")
        if isinstance(plane, GroundPlaneFailure)
        else (plane, float(std_m))
        for plane, std_m in zip(planes, cover_std_m, strict=True)
    ]
