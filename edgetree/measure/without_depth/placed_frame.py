"""The stems of a frame without depth, placed in another way, and the values that follow."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from basetree.arrays import Bool, Float, Index
from calib import RigidTransform
from edgetree.measure.base_ground import BaseGround
from edgetree.measure.constants.placing import (
    CUT_ABOVE_GROUND_M,
    CUT_ABOVE_GROUND_STD_M,
    HIDDEN_FOOT_STDS,
    RELIEF_STD_M,
    UNCHECKED_OUTLINE_STD,
)
from edgetree.measure.constants.stems import MAX_RELATIVE_STD
from edgetree.measure.cut_diameter import incomplete_stds
from edgetree.measure.estimates import Estimate, Failure, TreeMeasurement
from edgetree.measure.fitted_frame import FittedFrame
from edgetree.measure.keypoints import CUT
from edgetree.measure.observations import StemObservations
from edgetree.measure.section import Sections
from edgetree.measure.stem_fit import Stems
from edgetree.measure.taper import StemDiameters, Taper
from edgetree.measure.vertical import Verticals
from edgetree.measure.width import HalfAngle, fuse
from edgetree.measure.without_depth.foot_ground import FootGround
from edgetree.measure.without_depth.placement import Placement, SeenStems, Way, best_placement


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedFrame(FittedFrame):
    """As `FittedFrame`, with distances from a `Placement` in place of the depth.

    Attributes:
        numbers: (T,) numbers of the stems among all trees of the picture.
        placement: Where the stems are; None before they are placed.
    """

    numbers: Index
    placement: Placement | None = None

    def _failure_reason(self, index: int, outlined: bool) -> str | None:
        unseen = self._unseen_reason(index, outlined)
        if unseen is not None or self.placement is None:
            return unseen
        if self.placement.reasons[index] is not None:
            return self.placement.reasons[index]
        if not (self.stems.fitted[index] and self.finite[index]):
            return "the distance of the stem cannot be told"
        if self.stems.relative_size_std[index] > MAX_RELATIVE_STD:
            return self.placement.uncertain(index)
        return self._implausible_reason(index)

    @cached_property
    def several_stems(self) -> Bool:
        """(T,) whether depth shows several stems, of which there is none here."""
        return np.zeros(len(self.stems.distance_m), np.bool_)

    @cached_property
    def incomplete_std(self) -> Float:
        """As of `FittedFrame`; no depth tells whether a network's outline shows the stem alone."""
        unchecked = 0.0 if self.frame.masks_given else UNCHECKED_OUTLINE_STD
        return np.hypot(incomplete_stds(self.frame, self.observed, self.stems), unchecked)

    @cached_property
    def foot_hidden(self) -> Bool:
        """(T,) whether the mask ends above the keypoint of the cut, by more than their errors."""
        cut_px, keypoints = self.keypoints.xy_px[:, CUT], self.keypoints
        regions = None if self.observed.outline is None else self.observed.outline.regions
        if regions is None:
            return np.asarray(keypoints.within[:, CUT])
        below_px = np.vecdot(np.nan_to_num(self.lowest_px) - cut_px, regions.along)
        std_px = np.hypot(self.lowest_std_px, keypoints.std_px[:, CUT, 1])
        hidden = ~np.isfinite(self.lowest_px).all(1) | (below_px > HIDDEN_FOOT_STDS * std_px)
        return np.asarray(keypoints.within[:, CUT] & hidden)

    def _feet_px(self) -> tuple[Float, Float]:
        """(T, 2) lowest points of the stems, those of the cut where the foot is hidden; (T,) stds.

        Below the mask, a network infers the cut.
        """
        hidden, keypoints = self.foot_hidden, self.keypoints
        foot_px = np.where(hidden[:, None], keypoints.xy_px[:, CUT], self.lowest_px)
        std_px = np.where(hidden, keypoints.std_px[:, CUT, 1], self.lowest_std_px)
        return foot_px, np.maximum(std_px, 1.0)

    def seen_stems(self, verticals: Verticals) -> SeenStems:
        """What a way has to know; `verticals` are in the frame's axes."""
        regions = None if self.observed.outline is None else self.observed.outline.regions
        count, outline = len(self.stems.distance_m), self.observed.outline
        at = [verticals.at(index, None) for index in range(count)]
        edges_px: Float = np.full((2, count, 1, 2), np.nan)
        valid = np.zeros((2, count, 1), np.bool_)
        along_px = np.tile([0.0, -1.0], (count, 1))
        if outline is not None and regions is not None:
            edges_px = regions.points(outline.edges_px[..., None])[..., 0, :]
            valid, along_px = outline.valid, regions.along
        foot_px, foot_std_px = self._feet_px()
        return SeenStems(
            numbers=self.numbers,
            frame=self.frame,
            sections=self.stems.sections,
            middle_std_rad=self.stems.half_std_rad,
            foot_px=foot_px,
            foot_std_px=foot_std_px,
            foot_above_m=np.where(self.foot_hidden, CUT_ABOVE_GROUND_M, 0.0),
            foot_above_std_m=np.where(self.foot_hidden, CUT_ABOVE_GROUND_STD_M, 0.0),
            foot_within=np.isfinite(foot_px).all(1) & ~self.keypoints.reaches_lower_side,
            along_px=along_px,
            edges_px=edges_px,
            edges_valid=valid,
            up=np.array([each.up for each in at]).reshape(-1, 3),
            up_covariance=np.array([each.covariance for each in at]).reshape(-1, 3, 3),
        )

    def placed(self, ways: list[Way], verticals: Verticals) -> PlacedFrame:
        """The same stems at the distances that the ways tell.

        The widths along a stem depend on its distance, by the swell of the butt alone, so the
        stems are placed twice.
        """
        frame = self
        for _ in range(2):
            seen = frame.seen_stems(verticals)
            placement = best_placement([way.place(seen) for way in ways])
            frame = frame._at(placement)
        return frame

    def _at(self, placement: Placement) -> PlacedFrame:
        known = np.isfinite(placement.distance_m) & (placement.distance_m > 0)
        distance_m = np.where(known, placement.distance_m, 1.0)
        edges = replace(self.observed.edges, distance_m=distance_m)
        observed = replace(self.observed, edges=edges)
        sections, sources, _ = edges.sections(self.stems.sections.axes)
        frame = replace(self, observed=observed, placement=placement)
        stems = seen_only(observed, sections, sources, distance_m, self.stems.tilt_std_rad)
        frame = replace(frame, stems=stems)
        # The axis leans by an unknown angle towards or away from the camera.
        apart_m = np.abs(np.nan_to_num(placement.anchor_m))
        tilted = stems.tilt_std_rad * apart_m / distance_m
        stems = replace(
            stems,
            distance_std_m=np.hypot(placement.distance_std, tilted) * distance_m,
            size_std=np.hypot(placement.size_std, tilted),
        )
        return replace(frame, stems=stems)

    def grounds(self, verticals: Verticals) -> list[BaseGround | Failure]:
        """The ground through the foot of each stem; `verticals` are in the frame's axes."""
        stems, placement = self.stems, self.placement
        assert placement is not None
        feet = self.lowest_axis_m - stems.radius_m[:, None] * stems.sections.view_direction
        pixel_m = stems.distance_m * self.lowest_std_rad
        cut_off = self.keypoints.reaches_lower_side
        cover = Estimate(self.settings.ground_cover_m, self.settings.ground_cover_std_m)
        found: list[BaseGround | Failure] = []
        for index, foot_m in enumerate(feet):
            if cut_off[index] or not np.isfinite(foot_m).all():
                found.append(Failure("the foot of the stem is not in the picture"))
                continue
            if self.foot_hidden[index]:
                found.append(
                    Failure("plants hide the foot of the stem: its mask ends above the cut")
                )
                continue
            std_m = math.hypot(pixel_m.item(index), RELIEF_STD_M)
            vertical, size_std = verticals.at(index, None), stems.relative_size_std.item(index)
            normal = placement.normal[index]
            found.append(FootGround.at(foot_m, normal, vertical, std_m, size_std, cover))
        return found

    def tapers(self, diameters: StemDiameters, grounds: list[BaseGround | Failure]) -> list[Taper]:
        """As of `FittedFrame`; a volume has the error of the length too."""
        size_std = self.stems.relative_size_std.tolist()
        return [
            taper._replace(seen_volume_m3=_with_length(taper.seen_volume_m3, std))
            for taper, std in zip(super().tapers(diameters, grounds), size_std, strict=True)
        ]

    def measurement(
        self,
        index: int,
        cut: Float,
        ground: BaseGround | Failure,
        verticals: Verticals,
        taper: Taper,
        mounting: RigidTransform | None,
    ) -> TreeMeasurement:
        """As of `FittedFrame`; of the lean only the part across the view is seen."""
        assert self.placement is not None
        tree = super().measurement(index, cut, ground, verticals, taper, mounting)
        unseen = Failure(
            "without depth the lean towards or away from the camera is not seen; that across the"
            " view is the lean in the picture"
        )
        size_std = self.stems.relative_size_std.item(index)
        told = self.placement.evidence(index, size_std)
        evidence = replace(tree.evidence, distance_from=told)
        # Frames of one camera share most of what makes the distance uncertain.
        shared = {
            name: size_std * value.value
            for name in ("diameter_m", "dbh_m", "cut_height_m")
            if (value := getattr(tree, name))
        }
        return replace(
            tree,
            inclination_deg=unseen,
            lean_direction_deg=unseen,
            evidence=evidence,
            rig_std=shared,
        )


def seen_only(
    observed: StemObservations,
    sections: Sections,
    sources: list[HalfAngle],
    distance_m: Float,
    tilt_std_rad: Float,
) -> Stems:
    """T stems whose width is from their edges alone, and whose distance is given.

    Args:
        observed: What the picture shows of them.
        sections: The cross-sections by their edges.
        sources: Half angles from keypoints and from masks.
        distance_m: (T,) distances across the axes.
        tilt_std_rad: (T,) deviations of the axes' angles towards or away from the camera.
    """
    count, places = observed.readings.depth_m.shape
    unread = HalfAngle(np.ones(count), np.full(count, np.inf))
    half, weights = fuse([*sources, unread])
    return Stems(
        sections=sections,
        distance_m=distance_m,
        distance_std_m=np.zeros(count),
        tilt_std_rad=tilt_std_rad,
        half_std_rad=half.std_rad,
        # The front of the stem is given: its axis is at the front range over 1 - sin(delta).
        distance_change_per_rad=np.cos(half.rad) / (1 - np.sin(half.rad)),
        sources=[*sources, unread],
        weights=weights,
        arc_rad=np.zeros(count),
        used=np.full(count, places),
        agreeing=np.ones(count),
        distance_tilt_m_rad=np.zeros(count),
    )


def _with_length(volume: Estimate | Failure, size_std: float) -> Estimate | Failure:
    """A volume with the error of the stem's length, which is that of its diameters."""
    if isinstance(volume, Failure):
        return volume
    std = volume.std + size_std * volume.value
    if std > volume.value:
        return Failure(f"the volume is too uncertain: {volume.value:.2f} ± {std:.2f} m³")
    return Estimate(volume.value, std)
