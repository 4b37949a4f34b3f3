"""The fitted stems of a frame, and the values that follow from them and the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from basetree.arrays import Bool, Float
from calib import RigidTransform
from calib.directions import lengths
from edgetree.measure import foot
from edgetree.measure.base_ground import BaseGround, StemBases
from edgetree.measure.constants.depth import AXIS_DOUBT, MIN_DEPTH_SHARE
from edgetree.measure.constants.outlines import MIN_ON_STEM_SHARE
from edgetree.measure.constants.stems import (
    BREAST_HEIGHT_SHAPE,
    CUT_SHAPE,
    MIN_DIAMETER_M,
    TAPER_PER_M,
)
from edgetree.measure.cut_diameter import (
    SEEN_PART_WARNING,
    ButtSwell,
    diameter_stds_m,
    if_certain,
    incomplete_stds,
)
from edgetree.measure.estimates import Estimate, Failure, TreeMeasurement
from edgetree.measure.evidence import distance_place, gather_evidence, stump_warning
from edgetree.measure.foot_distance import FootDistances, foot_distances
from edgetree.measure.frame import DepthFrame
from edgetree.measure.keypoints import CUT, Keypoints
from edgetree.measure.observations import StemObservations
from edgetree.measure.position import StemPosition
from edgetree.measure.regions import STATIONS
from edgetree.measure.roundness import shows_several_stems
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.stem_fit import Stems
from edgetree.measure.taper import StemDiameters, Taper, height_scale, read_diameters
from edgetree.measure.vertical import Verticals
from edgetree.measure.volume import volume_by_dbh
from edgetree.measure.width import MaskWidths

# What depth within an outline that is not the stem's may be of; the second one is for beams.
_OF_OTHERS = (
    "what has depth within its outline may be a branch, netting or another thing in front",
    "the beams within its outline are of something that goes on beside it, before or behind it",
)


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedFrame:
    """The fitted stems of a frame, with the observations that they are fitted to.

    `feet` tells whose depth their feet contradict; None where none does. `ground_seen` tells
    whether ground may be seen at any of them: else a part may be far above the butt.
    """

    frame: DepthFrame
    keypoints: Keypoints
    observed: StemObservations
    stems: Stems
    roll_std_rad: Float
    feet: FootDistances | None = None
    ground_seen: bool = True

    @property
    def settings(self) -> MeasureSettings:
        """Assumptions of the measurement."""
        return self.frame.settings

    def failure_reasons(self) -> list[str | None]:
        """Why a stem cannot be measured at all, or None, for each stem."""
        outlined = np.asarray(self.observed.edges.valid.any(2).all(0))
        return [self._failure_reason(index, shown) for index, shown in enumerate(outlined)]

    def _failure_reason(self, index: int, outlined: bool) -> str | None:
        stems = self.stems
        if (unseen := self._unseen_reason(index, outlined)) is not None:
            return unseen
        outline = self.observed.outline
        if outline is not None and outline.smoothed_away[index]:
            return "the camera smooths the depth over more than the width of the stem"
        if self.observed.valid_depth_fraction[index] < MIN_DEPTH_SHARE:
            return "no depth on the stem"
        if not self.observed.plausible_depth[index]:
            return f"no depth on the stem: {_OF_OTHERS[self.frame.is_sparse]}"
        second = self.observed.second
        if second is not None and second.unclear[index]:
            return "the mask shows more than one stem, and nothing tells which one is meant"
        if not self.keypoints.has_section[index] and self.several_stems[index]:
            return "the mask shows more than one stem: its middle lies further back than its sides"
        if not (stems.fitted & self.observed.enough_used(stems.used) & self.finite)[index]:
            return "the depth on the stem does not agree with itself"
        return self._implausible_reason(index)

    def _unseen_reason(self, index: int, outlined: bool) -> str | None:
        """Why the picture shows too little of a stem, or None."""
        if not self.keypoints.has_section[index] and not outlined:
            if self.frame.masks is None:
                return "the diameter keypoints are not in the image"
            return "neither the diameter keypoints nor the mask show both edges of the stem"
        if self.observed.on_stem_fraction[index] < MIN_ON_STEM_SHARE:
            return "the mask shows hardly any of the stem"
        return None

    def _implausible_reason(self, index: int) -> str | None:
        """Why the diameter cannot be that of a stem, or None."""
        diameter_m = 2 * float(self.stems.radius_m[index])
        plausible = MIN_DIAMETER_M <= diameter_m <= self.settings.max_diameter_m
        return None if plausible else f"a diameter of {100 * diameter_m:.1f} cm is not plausible"

    def foot_failure(self, index: int) -> str | None:
        """Why the foot of a stem shows that its depth cannot be the stem's, or None."""
        if self.feet is None:
            return None
        return self.feet.failure(index, self.stems.distance_m.item(index))

    def cut_points(self) -> Float:
        """(T, 3) axis points at the felling cuts.

        Each is level with the point where the ray of the cut's keypoint meets the front of the
        stem. If the cut is not in the image, it is the axis point of the section; if the model
        gives no keypoints, it is the lowest one that the mask shows.
        """
        xy_px, known = self.keypoints.xy_px[:, CUT], self.keypoints.within[:, CUT]
        if not self.keypoints.offered:
            xy_px, known = self.lowest_px, np.asarray(np.isfinite(self.lowest_px).all(1))
        return self._axis_points(xy_px, known)

    def _axis_points(self, xy_px: Float, known: Bool) -> Float:
        """(T, 3) axis points level with the bark at (T, 2) pixels, or those of the section."""
        sections = self.stems.sections
        along, ahead = sections.axes.along, sections.view_direction
        rays = self.frame.rays(np.where(known[:, None], xy_px, 0.0))
        slope = (rays * along).sum(1) / (rays * ahead).sum(1) * sections.front_ratio
        height_ratio = np.where(known, slope, sections.height_ratio)
        return np.asarray(self.stems.distance_m[:, None] * (ahead + height_ratio[:, None] * along))

    @cached_property
    def lowest_px(self) -> Float:
        """(T, 2) lowest points of the masks on their stems; NaN where there are none."""
        if self.observed.outline is None:
            return np.full((len(self.stems.distance_m), 2), np.nan)
        return foot.lowest_seen_px(self.frame, self.observed.outline.regions)

    @cached_property
    def lowest_axis_m(self) -> Float:
        """(T, 3) axis points level with the lowest points of the masks; NaN without one."""
        seen = np.asarray(np.isfinite(self.lowest_px).all(1))
        return np.where(seen[:, None], self._axis_points(self.lowest_px, seen), np.nan)

    @cached_property
    def lowest_std_px(self) -> Float:
        """(T,) standard deviations of these points, up and down."""
        if self.observed.outline is None:
            return np.zeros(len(self.stems.distance_m))
        return foot.lowest_std_px(self.frame)

    @cached_property
    def lowest_std_rad(self) -> Float:
        """(T,) the same of their directions."""
        reach_px = self.frame.camera.fx * lengths(self.observed.edges.middle)
        return np.asarray(self.lowest_std_px / reach_px)

    def bases(self, cuts: Float) -> StemBases:
        """The lower ends of all stems; `cuts` are the (T, 3) axis points at the felling cuts."""
        sections = self.stems.sections
        along = self.widths.lowest_m()[:, None] * sections.axes.along
        front = self.stems.radius_m[:, None] * sections.view_direction
        return StemBases(
            indices=np.arange(len(cuts)),
            cuts=cuts,
            along=sections.axes.along,
            lowest=self.stems.distance_m[:, None] * sections.centre + along,
            radii_m=self.stems.radius_m,
            foot_within=self.observed.foot_within(self.keypoints),
            feet=self.lowest_axis_m - front,
            feet_std_m=self.stems.distance_m * self.lowest_std_rad,
            feet_px=self.lowest_px,
            feet_std_px=self.lowest_std_px,
        )

    def against_feet(self, bases: StemBases, grounds: list[BaseGround | Failure]) -> FittedFrame:
        """The same, corrected for late depth and less certain where feet contradict the depth.

        Args:
            bases: The lower ends of all T stems.
            grounds: Ground at each stem.
        """
        outline, stems = self.observed.outline, self.stems
        if outline is None:
            return self
        section_m = stems.distance_m[:, None] * stems.sections.centre
        along = stems.sections.axes.along
        below_m = np.vecdot(section_m - bases.feet, along)
        std_m = np.hypot(stems.distance_std_m, below_m * stems.tilt_std_rad)
        reach_px = self.frame.camera.fx * lengths(self.observed.edges.middle)
        above_m = np.vecdot(bases.cuts - section_m, along)
        cut_std_m = stems.distance_m * self.keypoints.cut_stds_px(above_m) / reach_px
        feet = foot_distances(self.frame, outline, bases, grounds, along, std_m, cut_std_m)
        lever_m = np.nan_to_num(np.maximum(below_m + self.widths.middle_m(), 0.0))
        tilt_rad = np.hypot(stems.tilt_std_rad, feet.turn_stds_rad(lever_m))
        moved_m = np.maximum(stems.distance_m - feet.late.expected_m, stems.distance_m / 2)
        doubt_m = np.hypot(stems.distance_std_m, feet.doubt_m)
        stems = replace(stems, distance_m=moved_m, distance_std_m=doubt_m, tilt_std_rad=tilt_rad)
        return replace(self, stems=stems, feet=feet)

    @cached_property
    def widths(self) -> MaskWidths:
        """Edges in the masks by height along the axes.

        Their error grows as that of the section does where keypoints, mask and depth disagree.
        """
        sections = self.stems.sections
        widths = self.observed.edges.mask_widths(sections.axes, sections.height_ratio)
        return replace(widths, std_rad=widths.std_rad * self.stems.disagreement)

    @cached_property
    def finite(self) -> Bool:
        """(T,) whether all standard deviations are finite."""
        errors = [self.roll_std_rad, self.stems.tilt_std_rad, self.diameter_std_m]
        return np.asarray(np.isfinite(errors).all(axis=0))

    @cached_property
    def several_stems(self) -> Bool:
        """(T,) whether the depth across the stem is that of several stems."""
        return shows_several_stems(self.stems, self.observed.readings, STATIONS)

    @cached_property
    def incomplete_std(self) -> Float:
        """(T,) relative standard deviations for incomplete or contradictory observations."""
        return incomplete_stds(self.frame, self.observed, self.stems)

    @cached_property
    def diameter_std_m(self) -> Float:
        """(T,) standard deviations of the diameters."""
        return diameter_stds_m(self.frame, self.stems, self.incomplete_std)

    @cached_property
    def butt_swell(self) -> ButtSwell:
        """How much thicker the stems are at the cut than at the section."""
        m_per_px = self.stems.distance_m / self.frame.camera.fy
        return ButtSwell.from_keypoints(self.keypoints, m_per_px, self.settings)

    def diameters(self, cuts: Float, grounds: list[BaseGround | Failure]) -> StemDiameters:
        """The diameters along each stem.

        Args:
            cuts: (T, 3) axis points at the felling cuts.
            grounds: Ground at each stem.
        """
        stems = self.stems
        cover_m = [each.cover_std_m if isinstance(each, BaseGround) else 0.0 for each in grounds]
        shared = (
            TAPER_PER_M * np.array(cover_m),
            stems.relative_size_std,
            np.full_like(stems.distance_m, self.frame.rig.size_std),
            self.incomplete_std,
        )
        return read_diameters(
            stems,
            self.widths,
            self.observed.edges,
            height_scale(stems, cuts, grounds),
            shared_std=np.linalg.norm(shared, axis=0),
            shape_std=BREAST_HEIGHT_SHAPE * self.settings.out_of_round_std,
            breast_height_m=self.settings.breast_height_m,
        )

    def tapers(self, diameters: StemDiameters, grounds: list[BaseGround | Failure]) -> list[Taper]:
        """What the diameters along each stem tell; places of edges are in the camera's axes."""
        if self.frame.masks is None:
            unseen = Failure("the model gives no masks to see the edges of the stem")
            without = Failure("the model gives no masks to see the stem at breast height")
            return [
                Taper(ground if isinstance(ground, Failure) else without, unseen, unseen, unseen)
                for ground in grounds
            ]
        not_seen = Failure("the stem is not seen at breast height")
        dbh = [
            ground if isinstance(ground, Failure) else breast or not_seen
            for ground, breast in zip(grounds, diameters.breast, strict=True)
        ]
        profiles = [
            replace(profile, edges_m=self.frame.to_camera(profile.edges_m)) if profile else profile
            for profile in diameters.profiles()
        ]
        return list(map(Taper, dbh, profiles, diameters.tapers_cm_per_m(), diameters.volumes_m3()))

    def measurement(
        self,
        index: int,
        cut: Float,
        ground: BaseGround | Failure,
        verticals: Verticals,
        taper: Taper,
        mounting: RigidTransform | None,
    ) -> TreeMeasurement:
        """All measurements of one tree.

        Args:
            index: Number of the tree.
            cut: (3,) axis point at the felling cut, in the frame's axes.
            ground: Ground at the tree, in the camera's axes as all that follows.
            verticals: The verticals of all trees.
            taper: Its diameters along the stem.
            mounting: Transform from camera to machine coordinates, if given.
        """
        stem = self._position(index, cut)
        at_section = Estimate(2 * stem.radius_m, stem.diameter_std_m)
        diameter, section = self.butt_swell.at_cut(index, at_section), if_certain(at_section)
        warnings = self.butt_swell.warnings[index]
        is_part = self.observed.above_foot[index] or not self.ground_seen
        if self.butt_swell.inferred[index] and is_part:
            diameter, warnings = taper.seen_part(at_section), (SEEN_PART_WARNING,)
            section = Failure("the diameter is that of another part")
        warnings += () if self.feet is None else self.feet.warning(index)
        vertical = ground.vertical if isinstance(ground, BaseGround) else verticals.at(index, None)
        inclination, direction = stem.lean(vertical, ground, self.settings)
        above_surface = stem.cut_height(ground)
        problem = self._cut_failure(index, stem, above_surface)
        if problem is not None:
            above_surface = problem
        height = stem.height_above_seen_ground(above_surface, ground)
        bend_rad, species = math.radians(self.settings.bend_std_deg), self.settings.species
        limit_m = self.settings.max_stump_height_m
        return TreeMeasurement(
            diameter_m=if_certain(diameter),
            dbh_m=taper.dbh_m,
            cut_height_m=height,
            inclination_deg=inclination,
            lean_direction_deg=direction,
            distance_m=stem.distance(bend_rad)
            if problem is None or not self.keypoints.offered
            else problem,
            axis_distance_m=stem.axis_distance(bend_rad),
            taper_cm_per_m=taper.taper_cm_per_m,
            seen_volume_m3=taper.seen_volume_m3,
            volume_m3=volume_by_dbh(species, taper.dbh_m),
            profile=taper.profile,
            species=species,
            cut_point_m=stem.cut_point() if problem is None else problem,
            cut_point_machine_m=stem.cut_point_machine(mounting) if problem is None else problem,
            axis=stem.axis(bend_rad, problem is None),
            section_m=section,
            evidence=gather_evidence(
                index,
                self.stems,
                self.observed,
                ground,
                distance_place(problem is None, self.keypoints.offered),
                warnings + stump_warning(height, above_surface, ground, limit_m),
            ),
            rig_std=stem.rig_std(taper.dbh_m, height, vertical),
        )

    def _cut_failure(
        self, index: int, stem: StemPosition, height: Estimate | Failure
    ) -> Failure | None:
        """Why the felling cut is unknown, or None if it is known."""
        if not self.keypoints.offered:
            return Failure("no keypoint tells the felling cut")
        if (above_px := self.keypoints.doubtful_cut_px.item(index)) > 0:
            std_px = float(self.keypoints.std_px[index, CUT, 1])
            return Failure(
                "the felling cut may be below the image: the stem reaches the lower edge, and the"
                f" keypoint is only {above_px:.0f} px above it (± {std_px:.0f} px)"
            )
        if not self.keypoints.within[index, CUT]:
            return Failure("the felling cut is not in the image")
        return stem.cut_failure(height, bool(self.keypoints.has_section[index]))

    def _position(self, index: int, cut: Float) -> StemPosition:
        stems, sections, to_camera = self.stems, self.stems.sections, self.frame.to_camera
        reach_px = self.frame.camera.fx * math.hypot(*self.observed.edges.middle[index].tolist())
        cut_rad = 0.0
        if self.keypoints.within[index, CUT]:
            cut_rad = self.keypoints.std_px.item(index, CUT, 1) / reach_px
        elif not self.keypoints.offered:
            cut_rad = self.lowest_std_rad.item(index)
        radius_m, incomplete_std = stems.radius_m.item(index), self.incomplete_std.item(index)
        return StemPosition(
            directions=to_camera(sections.directions[index]),
            section=to_camera(stems.distance_m[index] * sections.centre[index]),
            cut=to_camera(cut),
            radius_m=radius_m,
            distance_std_m=stems.distance_std_m.item(index),
            diameter_std_m=self.diameter_std_m.item(index),
            cut_rad=cut_rad,
            shape_std_m=CUT_SHAPE * self.settings.out_of_round_std * 2 * radius_m,
            roll_std_rad=self.roll_std_rad.item(index) * (1 + AXIS_DOUBT * incomplete_std),
            tilt_std_rad=stems.tilt_std_rad.item(index) * (1 + AXIS_DOUBT * incomplete_std),
            distance_tilt_m_rad=stems.distance_tilt_m_rad.item(index),
            rig=self.frame.rig,
            offset_m=self.settings.depth_bias_m,
        )
