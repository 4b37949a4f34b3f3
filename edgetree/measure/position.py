"""Distance, cut height, cut point and lean of one stem."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from basetree.arrays import Float
from calib import RigidTransform
from calib.directions import heading
from edgetree.measure.base_ground import BaseGround
from edgetree.measure.constants.stems import (
    HIGHEST_CUT_M,
    LOWEST_CUT_M,
    MAX_CUT_ABOVE_GROUND_M,
    MAX_CUT_BELOW_GROUND_M,
    MIN_LEAN_STDS,
    SEEN_BEND_SHARE,
    TAPER_STD_PER_M,
    UNSEEN_BEND_SHARE,
)
from edgetree.measure.estimates import Estimate, Failure, PointEstimate, StemAxis
from edgetree.measure.even_cover import above_soil
from edgetree.measure.rig_uncertainty import RigErrors
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.vertical import Vertical


@dataclass(frozen=True, eq=False, kw_only=True)
class StemPosition:
    """Position and direction of one stem and its felling cut, in camera coordinates.

    Attributes:
        directions: (3, 3) unit vectors in rows: across the axis from the camera to the axis, at
            right angles to the axis to the right, and up the axis.
        section: (3,) axis point of the section at which the diameter is measured.
        cut: (3,) axis point of the felling cut.
        radius_m: Radius at the section.
        distance_std_m: Standard deviation of the axis' distance.
        diameter_std_m: Standard deviation of the diameter.
        cut_rad: Standard deviation of the cut's direction, up and down.
        shape_std_m: Displacement of the axis between section and cut by bark, butt swell and
            bends, as a standard deviation.
        roll_std_rad: Standard deviation of the axis' angle within the image.
        tilt_std_rad: Standard deviation of the axis' angle towards or away from the camera.
        distance_tilt_m_rad: Covariance of the axis' distance with its change per metre along it.
        rig: Errors of the rig.
        offset_m: Standard deviation of an offset of all depths of the rig.
    """

    directions: Float
    section: Float
    cut: Float
    radius_m: float
    distance_std_m: float
    diameter_std_m: float
    cut_rad: float
    shape_std_m: float
    roll_std_rad: float
    tilt_std_rad: float
    distance_tilt_m_rad: float
    rig: RigErrors
    offset_m: float

    @property
    def along(self) -> Float:
        """(3,) unit vector up the axis."""
        return np.asarray(self.directions[2])

    @cached_property
    def _cut_parts_m(self) -> tuple[float, float, float]:
        """Parts of the cut in the three directions."""
        return _parts(self.directions, self.cut)

    @cached_property
    def _section_parts_m(self) -> tuple[float, float, float]:
        """Parts of the section in the three directions."""
        return _parts(self.directions, self.section)

    @cached_property
    def _range_m(self) -> float:
        """Distance of the cut from the camera."""
        return math.hypot(*self.cut.tolist())

    def distance(self, bend_rad: float) -> Estimate:
        """Distance in metres from the camera to the axis at the cut.

        The depth shows the bark, one radius in front of the axis, so the error of the radius is
        part of the distance's. From the section to the cut the axis is extended, with its errors
        and the taper as in `axis_distance`.

        Args:
            bend_rad: Standard deviation of the axis direction along a stem.
        """
        below_m = self._section_parts_m[2] - self._cut_parts_m[2]
        direction_std = math.hypot(self.tilt_std_rad, TAPER_STD_PER_M * self.radius_m, bend_rad)
        extended_m = below_m * direction_std / self._slant
        shared = -2 * below_m * self.distance_tilt_m_rad
        rig_m = self.rig.std_m(self.cut, self.cut / self._range_m)
        variance = math.hypot(self._at_section_std_m, extended_m, rig_m) ** 2 + shared
        return Estimate(self._range_m, math.sqrt(variance))

    @cached_property
    def _at_section_std_m(self) -> float:
        """Standard deviation of the distance by the section alone, without errors of the rig."""
        parts = (self._depth_std_m, self.diameter_std_m / 2, self._along_std_m)
        return math.hypot(*parts, self.shape_std_m)

    def axis_distance(self, bend_rad: float) -> Estimate:
        """Shortest distance in metres from the camera to the line of the axis.

        The depth shows the line at the section. From there to the camera's level the line is
        extended, with the error of its direction and the bend of real stems. The depth is that of
        the bark. As the stem gets thinner upwards, its bark recedes by half of the taper, which
        the fit has taken from the tilt.

        Args:
            bend_rad: Standard deviation of the axis direction along a stem.
        """
        ahead_m, _, level_m = self._section_parts_m
        bend_share = SEEN_BEND_SHARE if level_m < 0 else UNSEEN_BEND_SHARE
        bent_rad = bend_share * bend_rad
        direction_std = math.hypot(self.tilt_std_rad, TAPER_STD_PER_M * self.radius_m, bent_rad)
        ahead = self.directions[0]
        rig_m = self.rig.std_m(ahead_m * ahead, ahead)
        parts = (self.distance_std_m, self.diameter_std_m / 2, level_m * direction_std, rig_m)
        shared = -2 * level_m * self.distance_tilt_m_rad
        return Estimate(ahead_m, math.sqrt(math.hypot(*parts) ** 2 + shared))

    @property
    def _slant(self) -> float:
        """Ratio of the cut's distance and that of the axis, which is across the axis."""
        return self._range_m / max(self._cut_parts_m[0], 1e-6)

    @property
    def _depth_std_m(self) -> float:
        """Standard deviation of the distance from that of the axis."""
        return self.distance_std_m * self._slant

    @property
    def _along_std_m(self) -> float:
        """Standard deviation of the distance from the cut's position along the axis.

        A turn of the line of sight by an angle moves the cut along the axis by |cut| * slant *
        angle. By h along the axis from the camera's level, the distance changes by h / |cut| per
        metre. The product is h * slant * angle.
        """
        return abs(self._cut_parts_m[2]) * self._slant * self.cut_rad

    def cut_height(self, ground: BaseGround | Failure) -> Estimate | Failure:
        """Height of the cut in metres above the ground on the uphill side, along the vertical.

        The cut's own error has two parts: the error of the distance times the rise per metre of
        distance, and the error of the cut's direction times the distance.
        """
        if isinstance(ground, Failure):
            return ground
        rise = float(self.cut @ ground.up) / self._range_m
        height = ground.height_m(self.cut, self.along, self.radius_m)
        if isinstance(height, Failure):
            return height
        cut_m = self.cut_rad * self._range_m
        std = ground.cut_std_m(height.value, rise, self._at_section_std_m, cut_m)
        height = Estimate(height.value, math.hypot(height.std, std))
        rig_m = self.rig.std_m(height.value * self.along, ground.up)
        return Estimate(height.value, math.hypot(height.std, rig_m))

    def rig_std(
        self, dbh: Estimate | Failure, height: Estimate | Failure, vertical: Vertical
    ) -> dict[str, float]:
        """Parts of the standard deviations from the rig, see `TreeMeasurement.rig_std`."""
        tilt_rad = vertical.tilt_std_rad if vertical.stems is None else 0.0
        size_std = math.hypot(self.rig.size_std, self.offset_m / math.hypot(*self.section.tolist()))
        parts = {
            "diameter_m": size_std * 2 * self.radius_m,
            "inclination_deg": math.degrees(tilt_rad),
        }
        if isinstance(dbh, Estimate):
            parts["dbh_m"] = size_std * dbh.value
        if isinstance(height, Estimate):
            own_m = self.rig.std_m(height.value * self.along, vertical.up)
            parts["cut_height_m"] = math.hypot(own_m, self.radius_m * tilt_rad)
        return parts

    def cut_failure(self, height: Estimate | Failure, has_section: bool) -> Failure | None:
        """Why the keypoint of the felling cut is implausible, or None if it is plausible.

        Args:
            height: Height of the cut above the ground.
            has_section: Whether the section is given by keypoints, which are near the cut.
        """
        above_m = self._cut_parts_m[2] - self._section_parts_m[2]
        if has_section and not LOWEST_CUT_M <= above_m <= HIGHEST_CUT_M:
            side = "above" if above_m > 0 else "below"
            return Failure(
                f"the felling cut is {100 * abs(above_m):.0f} cm {side} the diameter's section"
            )
        if isinstance(height, Estimate) and height.value < -MAX_CUT_BELOW_GROUND_M - 2 * height.std:
            return Failure(f"the felling cut is {-100 * height.value:.0f} cm below the ground")
        if isinstance(height, Estimate) and height.value > MAX_CUT_ABOVE_GROUND_M + 2 * height.std:
            return Failure(
                f"the felling cut is {100 * height.value:.0f} cm above the ground: the"
                " depth may be of"
                " what stands before the stem"
            )
        return None

    def height_above_seen_ground(
        self, height: Estimate | Failure, ground: BaseGround | Failure
    ) -> Estimate | Failure:
        """The height of the cut, or a failure if plants hide the ground.

        They do if the surface is too unsteady for ground, if gaps or the stem show deeper ground,
        or if the cut comes out below it by more than its own error. A height that is less certain
        than half the height of the highest stumps is not given either.

        Args:
            height: Height of the cut above the ground on the uphill side.
            ground: Ground at the stem.
        """
        if isinstance(height, Failure) or isinstance(ground, Failure):
            return height
        above_axis_m = height.value + ground.uphill_m(self.radius_m)
        if above_axis_m < -self.cut_rad * self._range_m or height.value < -height.std:
            lower_m = -min(above_axis_m, height.value)
            return Failure(
                f"plants hide the ground: the felling cut is {100 * lower_m:.0f} cm below"
                " the lowest"
                " surface around the base"
            )
        soil = above_soil(height, ground.stated_cover.value > 0)
        if ground.hidden:
            return Failure(
                f"plants hide the ground: the felling cut is {100 * soil.value:.0f} cm or"
                " more above it, as"
                " the surface or the stem shows deeper ground"
            )
        if soil.std > MAX_CUT_ABOVE_GROUND_M / 2:
            return Failure(
                f"the height of the felling cut is uncertain by {100 * soil.std:.0f} cm: expected"
                f" less than {50 * MAX_CUT_ABOVE_GROUND_M:.0f} cm, as stumps are low"
            )
        return soil

    def cut_point(self) -> PointEstimate:
        """Point of the cut on the bark that faces the camera, in camera coordinates."""
        return PointEstimate(self._bark, np.sqrt(self._covariance.diagonal()))

    def cut_point_machine(self, mounting: RigidTransform | None) -> PointEstimate | Failure:
        """The same point in machine coordinates."""
        if mounting is None:
            return Failure("no mounting of the camera given")
        turn = np.asarray(mounting.rotation, np.float64)
        covariance = turn @ self._covariance @ turn.T
        covariance += self.rig.turned_covariance(turn @ self._bark)
        return PointEstimate(np.asarray(mounting.apply(self._bark)), np.sqrt(covariance.diagonal()))

    def axis(self, bend_rad: float, has_cut: bool) -> StemAxis:
        """The line of the axis in camera coordinates.

        The depth shows the bark, one radius in front of the axis, so the error of the radius is
        part of the point's. To the side, an error of one edge moves the axis by half as much as it
        changes the diameter.

        Args:
            bend_rad: Standard deviation of the axis direction along a stem.
            has_cut: Whether the cut is known, and the point is taken there.
        """
        slide_m = self.cut_rad * self._range_m if has_cut else 0.0
        ahead_m = math.hypot(self.distance_std_m, self.diameter_std_m / 2, self.shape_std_m)
        tilt_std = math.hypot(self.tilt_std_rad, bend_rad)
        roll_std = math.hypot(self.roll_std_rad, bend_rad)
        point, own = self.cut if has_cut else self.section, (ahead_m, self.diameter_std_m / 2)
        turn = self.rig.direction_covariance(self.along)
        return StemAxis(
            point_m=point,
            point_covariance_m2=self._summed(*own, slide_m) + self.rig.covariance(point),
            direction=self.along,
            direction_covariance=self._summed(tilt_std, roll_std, 0.0) + turn,
        )

    @property
    def _bark(self) -> Float:
        """(3,) point of the cut on the bark that faces the camera."""
        return np.asarray(self.cut - self.radius_m * self.directions[0])

    @cached_property
    def _covariance(self) -> Float:
        """(3, 3) covariance matrix of the cut point in m².

        The sum of independent errors in three directions, and of the rig's. The depth shows the
        bark itself, so only a part of the error of the diameter counts; these parts are rough
        values.
        """
        edge_m, slide_m = self.diameter_std_m / 4, self.cut_rad * self._range_m
        own = self._summed(math.hypot(self._depth_std_m, edge_m), edge_m + slide_m / 2, slide_m)
        return own + self.rig.covariance(self._bark)

    def _summed(self, ahead: float, across: float, along: float) -> Float:
        """(3, 3) covariance of independent errors of these deviations in the three directions."""
        scaled = self.directions * np.array([[ahead], [across], [along]])
        return np.asarray(scaled.T @ scaled)

    def lean(
        self, vertical: Vertical, ground: BaseGround | Failure, settings: MeasureSettings
    ) -> tuple[Estimate | Failure, Estimate | Failure]:
        """Inclination of the axis from the vertical, and the direction of the lean, in degrees.

        The inclination has a sideways component (roll) and one along the line of sight (tilt).
        Its variance, and that of the direction, follow from those of both components by
        first-order error propagation in polar coordinates.

        Args:
            vertical: The vertical at the stem.
            ground: Ground at the stem.
            settings: Bend of stems.

        Returns:
            The inclination, and its direction as in `TreeMeasurement.lean_direction_deg`.
        """
        if isinstance(ground, Failure) and not vertical.shows_leans:
            missing = Failure(f"no vertical: {ground.reason}")
            return missing, missing
        up = vertical.up
        tilt, roll, cosine = _parts(self.directions, up)
        value = math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))
        total = roll**2 + tilt**2
        roll_part = roll**2 / total if total > 0 else 0.5
        bend = math.radians(settings.bend_std_deg)
        ahead_std, across_std, _ = vertical.stds_rad(self.directions)
        roll_std = math.hypot(self.roll_std_rad, across_std, bend)
        tilt_std = math.hypot(self.tilt_std_rad, ahead_std, bend)
        std_deg = math.degrees(math.sqrt(roll_part * roll_std**2 + (1 - roll_part) * tilt_std**2))
        inclination = Estimate(value, std_deg)
        if not vertical.has_directions:
            return inclination, Failure("no vertical given to tell the direction of the lean")
        if value < MIN_LEAN_STDS * std_deg:
            return inclination, Failure(
                f"upright within its error: {value:.1f} ± {std_deg:.1f} deg"
            )
        sideways = math.sqrt((1 - roll_part) * roll_std**2 + roll_part * tilt_std**2)
        direction_std_deg = math.degrees(sideways / math.radians(max(value, 1e-3)))
        return inclination, Estimate(self._lean_direction_deg(up), direction_std_deg)

    def _lean_direction_deg(self, vertical: Float) -> float:
        """Direction of the lean, clockwise from the camera's forward, as seen from above."""
        ahead = heading(vertical)
        # The cross product (vertical x along) points horizontally, at right angles to the lean.
        (ax, ay, az), (ux, uy, uz) = self.along.tolist(), vertical.tolist()
        sideways = np.array([uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax])
        return math.degrees(math.atan2(float(sideways @ ahead), float(self.along @ ahead)))


def _parts(directions: Float, vector: Float) -> tuple[float, float, float]:
    """Dot products of a (3,) vector with the rows of (3, 3) directions."""
    ahead, across, along = (directions @ vector).tolist()
    return ahead, across, along
