"""The lower ends of stems and the ground there, above which heights are measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from basetree.arrays import Bool, Float, Index
from calib import GroundPlane
from edgetree.measure.constants.ground import (
    LIFT,
    LITTER_STD_M,
    MAX_COVER_STD_M,
    MIN_COVER_STD_M,
    MIN_PLANTS_SHARE,
    OUTLIER_STD_M,
    SEARCH_RADIUS_M,
)
from edgetree.measure.estimates import Estimate, Failure
from edgetree.measure.vertical import Vertical

# Smallest cosine of the angle between an axis and the ground's normal, or the vertical. It keeps
# lengths along a lying stem finite.
_MIN_COSINE = 0.2
_NO_COVER = Estimate(0.0, 0.0)


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

    def height_m(self, axis_point: Float, along: Float, radius_m: float) -> Estimate | Failure:
        """Height of a point of the axis above the ground on the stem's uphill side.

        The axis is followed to the ground, which lies `below_plane_m` below the plane. On the
        uphill side of the stem the ground is higher by the radius times the tangent of its slope.

        Args:
            axis_point: (3,) camera point on the axis.
            along: (3,) unit vector up the axis.
            radius_m: Radius of the stem.

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
        return Estimate(value, math.hypot(*parts))

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
