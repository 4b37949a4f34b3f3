"""All trees of a frame at once, from what is seen of them to measurements."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import CAMERA_UP, RigidTransform
from edgetree.detections import TreeDetections
from edgetree.measure.axis import fit_axes
from edgetree.measure.estimates import Estimate, Evidence, Failure, TreeMeasurement
from edgetree.measure.frame import DepthFrame
from edgetree.measure.ground import BaseGround, find_grounds
from edgetree.measure.look import CUT, Keypoints, StemLook, look_at_stems
from edgetree.measure.place import CAMERA_UP_STD_DEG, StemPlace
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.stem import USED_WIDTH, Stems, fit_stems
from edgetree.measure.width import HalfAngle

__all__ = ["measure_all"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

_SOURCES = ("keypoints", "mask", "depth")
_COUNTED = 0.02
# What the used part of the width shows of a stem's round at most.
_WHOLE_ARC_RAD = 2 * math.asin(USED_WIDTH)
_MOST_DOUBT = 0.3
# Stems are so much less regular at breast height, with its branches, and between section and cut,
# with its swell, than the section is out of round.
_BREAST_SHAPE, _CUT_SHAPE = 2.0, 2.6
_LEAST_SHOWN = 0.03
_LEAST_DEPTH_SHARE = 0.05
_LEAST_DIAMETER_M = 0.02
_MOST_RELATIVE_STD = 0.5
_MOST_DISAGREEMENT = 3.0


def measure_all(
    frame: DepthFrame, trees: TreeDetections, up: Float | None, mounting: RigidTransform | None
) -> list[TreeMeasurement]:
    """Measure the trees of a frame, at least one.

    Args:
        frame: depth, camera, masks and settings.
        trees: the detections.
        up: (3,) unit vector of the vertical; None takes the grounds' normals.
        mounting: from the camera's frame to the machine's.
    """
    settings = frame.settings
    keypoints = Keypoints.of(trees, settings)
    with np.errstate(all="ignore"):
        look = look_at_stems(frame, trees.boxes_px.astype(np.float64), keypoints)
        vertical = np.array(CAMERA_UP) if up is None else up
        crooked_deg = CAMERA_UP_STD_DEG if up is None else 0.0
        lean_std_rad = float(np.radians(np.hypot(settings.lean_std_deg, crooked_deg)))
        frames, roll_std_rad = fit_axes(look.axis_rays, look.axis_std_rad, vertical, lean_std_rad)
        stems = fit_stems(look.readings, frames, look.edges, lean_std_rad, settings)
        work = _Work(frame, keypoints, look, stems, roll_std_rad)
        reasons = work.reasons()
        cuts = work.cuts()
        sound = np.array([reason is None for reason in reasons])
        grounds: list[BaseGround | Failure] = [Failure("")] * len(sound)
        places = np.flatnonzero(sound)
        if len(places):
            found = find_grounds(frame, cuts[places], stems.radius_m[places], up)
            for place, ground in zip(places, found, strict=True):
                grounds[place] = ground
        breast = work.breast(cuts, grounds)
        return [
            TreeMeasurement.failed(reason)
            if reason is not None
            else work.measurement(place, cuts[place], grounds[place], breast[place], up, mounting)
            for place, reason in enumerate(reasons)
        ]


@dataclass(frozen=True, eq=False)
class _Work:
    """What is known of T stems once depth and outline are fitted."""

    frame: DepthFrame
    keypoints: Keypoints
    look: StemLook
    stems: Stems
    roll_std_rad: Float

    @property
    def settings(self) -> MeasureSettings:
        return self.frame.settings

    def reasons(self) -> list[str | None]:
        """Why nothing can be measured of a stem, if so."""
        return [self._reason(place) for place in range(len(self.roll_std_rad))]

    def _reason(self, place: int) -> str | None:
        edges, stems = self.look.edges, self.stems
        outlined = edges.left_valid[place].any() and edges.right_valid[place].any()
        if not self.keypoints.has_section[place] and not outlined:
            if self.frame.masks is None:
                return "the diameter keypoints are not in the image"
            return "neither the diameter keypoints nor the mask show both edges of the stem"
        if self.look.places[place] < _LEAST_SHOWN:
            return "the mask shows hardly any of the stem"
        if self.look.valid_depth[place] < _LEAST_DEPTH_SHARE:
            return "no depth on the stem"
        if not (stems.fitted[place] and self.finite[place]):
            return "the depth on the stem does not agree with itself"
        diameter_m = 2 * float(stems.radius_m[place])
        if not _LEAST_DIAMETER_M <= diameter_m <= self.settings.max_diameter_m:
            return f"a diameter of {diameter_m:.2f} m is not plausible"
        return None

    def cuts(self) -> Float:
        """(T, 3) points of the axes level with where the cuts' rays meet the fronts of the stems;
        of the sections where the cut is not in the image.
        """
        sections = self.stems.sections
        rays = self.frame.rays(
            np.where(self.keypoints.within[:, CUT, None], self.keypoints.xy_px[:, CUT], 0.0)
        )
        along, facing = sections.frames.along, sections.facing
        slope = (rays * along).sum(1) / (rays * facing).sum(1) * sections.front_share
        height = np.where(self.keypoints.within[:, CUT], slope, sections.height)
        return np.asarray(self.stems.distance_m[:, None] * (facing + height[:, None] * along))

    @cached_property
    def finite(self) -> Flags:
        """(T,) whether all errors can be stated."""
        errors = [self.roll_std_rad, self.stems.tilt_std_rad, self.diameter_std_m]
        return np.asarray(np.isfinite(errors).all(axis=0))

    @cached_property
    def diameter_std_m(self) -> Float:
        """(T,) from distance, edges, calibration and shape."""
        stems, camera = self.stems, self.frame.camera
        half = stems.sections.half_rad
        edges = stems.half_std_rad * np.abs(1 / np.tan(half) + stems.growth)
        distance = stems.distance_std_m / stems.distance_m
        focal = np.full_like(half, camera.focal_std_px / camera.fx)
        shape = np.full_like(half, self.settings.out_of_round_std)
        parts = [edges, distance, focal, shape, self.doubts]
        return np.asarray(2 * stems.radius_m * np.linalg.norm(parts, axis=0))

    @cached_property
    def doubts(self) -> Float:
        """(T,) of the diameter, for what of the stem could not be seen, or contradicts itself."""
        settings, edges = self.settings, self.look.edges
        both = (edges.left_valid & edges.right_valid).mean(1)
        outline = 0.0 if self.look.outline is None else settings.outline_doubt
        hidden = np.maximum(1 - self.stems.arc_rad / _WHOLE_ARC_RAD, 0.0)
        parts = (
            outline * (1 - both) ** 2,
            settings.depth_doubt * (1 - self.stems.agreeing) ** 2,
            settings.arc_doubt * hidden,
        )
        return np.asarray(np.minimum(np.linalg.norm(parts, axis=0), _MOST_DOUBT))

    def _swollen(self, place: int, diameter: Estimate) -> tuple[Estimate, tuple[str, ...]]:
        """The diameter at a cut below the picture, from where the stem shows lowest."""
        points = self.keypoints
        if points.has_section[place] or points.within[place, CUT] or not points.offered:
            return diameter, ()
        settings = self.settings
        value = diameter.value * (1 + settings.butt_swell)
        std = math.hypot(diameter.std, diameter.value * settings.butt_swell_std)
        warning = "the cut is not in the picture: its diameter is inferred from the stem above"
        return Estimate(value, std), (warning,)

    def breast(self, cuts: Float, grounds: list[BaseGround | Failure]) -> list[Estimate | Failure]:
        """Diameters at breast height, where the mask shows the stem there."""
        stems, sections = self.stems, self.stems.sections
        above = np.zeros(len(cuts))
        for place, ground in enumerate(grounds):
            if isinstance(ground, BaseGround):
                along, radius_m = sections.frames.along[place], float(stems.radius_m[place])
                to_section = (stems.distance_m * sections.height)[place] - cuts[place] @ along
                above[place] = ground.axis_length_m(
                    cuts[place], along, radius_m, self.settings.breast_height_m
                ) - float(to_section)
        edges = self.look.edges
        widths = edges.mask_widths(sections.frames, sections.height)
        half, _ = widths.at(above)
        seen = widths.seen_at(above)
        return [
            self._breast(place, grounds[place], half, bool(seen[place]))
            for place in range(len(cuts))
        ]

    def _breast(
        self, place: int, ground: BaseGround | Failure, half: HalfAngle, seen: bool
    ) -> Estimate | Failure:
        if isinstance(ground, Failure):
            return ground
        if self.frame.masks is None:
            return Failure("the model gives no masks to see the stem at breast height")
        if not seen or not np.isfinite(half.std_rad[place]):
            return Failure("the stem is not seen at breast height")
        stems = self.stems
        distance_m = float(stems.distance_m[place])
        value = 2 * distance_m * float(np.sin(half.rad[place]))
        shares = (
            float(half.std_rad[place] / np.tan(half.rad[place])),
            float(stems.distance_std_m[place]) / distance_m,
            float(stems.tilt_std_rad[place]) * self.settings.breast_height_m / distance_m,
            _BREAST_SHAPE * self.settings.out_of_round_std,
            float(self.doubts[place]),
        )
        return _sure_enough(Estimate(value, value * math.hypot(*shares)))

    def measurement(
        self,
        place: int,
        cut: Float,
        ground: BaseGround | Failure,
        breast: Estimate | Failure,
        up: Float | None,
        mounting: RigidTransform | None,
    ) -> TreeMeasurement:
        """One tree."""
        stem = self._placed(place, cut)
        measured = Estimate(2 * stem.radius_m, stem.diameter_std_m)
        swollen, warnings = self._swollen(place, measured)
        diameter = _sure_enough(swollen)
        inclination, direction = stem.lean(up, ground, self.settings)
        height = stem.cut_height(ground)
        offered = self.keypoints.offered
        problem: Failure | None = None
        if not offered:
            problem = Failure("no keypoint tells the felling cut")
        elif not self.keypoints.within[place, CUT]:
            problem = Failure("the felling cut is not in the image")
        else:
            problem = stem.misplaced(height, bool(self.keypoints.has_section[place]))
        evidence = self._evidence(place, ground, height if problem is None else problem, warnings)
        if problem is not None:
            return TreeMeasurement(
                diameter,
                breast,
                problem,
                inclination,
                direction,
                problem if offered else stem.distance(),
                problem,
                problem,
                evidence,
            )
        return TreeMeasurement(
            diameter,
            breast,
            height,
            inclination,
            direction,
            stem.distance(),
            stem.cut_point(),
            stem.cut_point_machine(mounting),
            evidence,
        )

    def _placed(self, place: int, cut: Float) -> StemPlace:
        stems, sections = self.stems, self.stems.sections
        ray = self.look.edges.section[place].mean(0)
        pixel_rad = 1 / (self.frame.camera.fx * float(np.linalg.norm(ray)))
        return StemPlace(
            along=sections.frames.along[place],
            across=sections.frames.across[place],
            facing=sections.facing[place],
            section=stems.distance_m[place] * sections.centre[place],
            cut=cut,
            radius_m=float(stems.radius_m[place]),
            distance_std_m=float(stems.distance_std_m[place]),
            diameter_std_m=float(self.diameter_std_m[place]),
            cut_rad=float(self.keypoints.std_px[place, CUT, 1]) * pixel_rad,
            shape_std_m=_CUT_SHAPE
            * self.settings.out_of_round_std
            * 2
            * float(stems.radius_m[place]),
            roll_std_rad=float(self.roll_std_rad[place]),
            tilt_std_rad=float(stems.tilt_std_rad[place]),
        )

    def _evidence(
        self,
        place: int,
        ground: BaseGround | Failure,
        height: Estimate | Failure,
        warnings: tuple[str, ...],
    ) -> Evidence:
        stems = self.stems
        distance_m = float(stems.distance_m[place])
        known = {
            name: (float(half.rad[place]), float(half.std_rad[place]))
            for name, half in zip(_SOURCES, self.stems.sources, strict=True)
            if np.isfinite(half.std_rad[place])
        }
        diameters = {name: 2 * distance_m * math.sin(rad) for name, (rad, _) in known.items()}
        stds = {name: 2 * distance_m * math.cos(rad) * std for name, (rad, std) in known.items()}
        counted = [n for n, s in zip(_SOURCES, stems.shares[place], strict=True) if s > _COUNTED]
        outline = self.look.outline
        return Evidence(
            " + ".join(counted),
            diameters,
            stds,
            float(np.degrees(stems.arc_rad[place])),
            float(self.look.valid_depth[place]),
            None if outline is None else float(outline.shown[place]),
            ground.in_words() if isinstance(ground, BaseGround) else ground.reason,
            warnings + self._warnings(height, diameters, stds),
        )

    def _warnings(
        self, height: Estimate | Failure, diameters: dict[str, float], stds: dict[str, float]
    ) -> tuple[str, ...]:
        warnings = []
        limit_m = self.settings.max_stump_height_m
        if isinstance(height, Estimate) and height.value - height.std > limit_m:
            warnings.append(
                f"the stump would be {height.value:.2f} ± {height.std:.2f} m high,"
                f" limit {limit_m:.2f} m"
            )
        names = [name for name in ("keypoints", "mask") if name in diameters]
        if len(names) == 2:
            apart = abs(diameters["keypoints"] - diameters["mask"])
            if apart > _MOST_DISAGREEMENT * math.hypot(stds["keypoints"], stds["mask"]):
                warnings.append(
                    f"keypoints and mask disagree: {diameters['keypoints']:.2f} m"
                    f" and {diameters['mask']:.2f} m"
                )
        return tuple(warnings)


def _sure_enough(diameter: Estimate) -> Estimate | Failure:
    if not diameter.std <= _MOST_RELATIVE_STD * diameter.value:
        return Failure(
            f"the diameter is too uncertain: {diameter.value:.2f} m ± {diameter.std:.2f} m"
        )
    return diameter
