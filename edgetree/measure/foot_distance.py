"""Compare the distances of stems by their depth with the places where their feet meet the ground.

The ray through the lower end of a mask meets the ground at the foot. This tells a stem's distance
without any depth on the stem. Two things part the distances:

- Depth of an earlier moment. A machine that drives ahead finds its stems too far away, all by the
  same length, while the ground that passes below it stays as it is.
- Something in front, such as brush or a branch, whose depth is taken for the stem's. Then the
  ground just below the mask, in front of the foot, is further away than the stem is said to be.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from edgetree.measure.base_ground import BaseGround, DistrustedGround, StemBases
from edgetree.measure.constants.ground import (
    FOOT_DISTANCE_STDS,
    LITTER_STD_M,
    MIN_LATE_SHIFT_M,
    MOVED_BY_TURN_M,
    OTHER_FOOT_SHARE,
    UNEVEN_STD_M,
)
from edgetree.measure.constants.placing import CUT_ABOVE_GROUND_M, CUT_ABOVE_GROUND_STD_M
from edgetree.measure.constants.stems import MAX_RELATIVE_STD
from edgetree.measure.estimates import Failure
from edgetree.measure.foot_readings import below_feet, goes_on_below
from edgetree.measure.frame import DepthFrame
from edgetree.measure.late_depth import LateDepth, late_depth
from edgetree.measure.outline import Outline

# The ray meets the ground where it falls by this share of the camera's height at least.
_MIN_FALL = 0.1
# Smallest cosine of the angle between an axis and the ground's normal.
_MIN_COSINE = 0.2
# Among many plants, a foot is moved by something else with this probability at most.
_MAX_OTHER = 0.95


class FootDistances(NamedTuple):
    """How far T stems are from where their feet meet the ground, as seen from the camera.

    Attributes:
        beyond_m: (T,) distance by the depth less that by the foot; NaN where no foot is seen.
        std_m: (T,) its standard deviation.
        told: (T,) whether the foot of a stem contradicts its depth by itself.
        late: Whether the depth of the frame is of an earlier moment.
        doubt_m: (T,) standard deviations to add to those of the corrected distances.
        own_doubt_m: (T,) part of the difference that depth of an earlier moment does not explain.
        high: (T,) whether the felling cut comes out higher than usual.
    """

    beyond_m: Float
    std_m: Float
    told: Bool
    late: LateDepth
    doubt_m: Float
    own_doubt_m: Float
    high: Bool

    def warning(self, index: int) -> tuple[str, ...]:
        """What the foot of one stem, or those of the others, tells of its depth."""
        beyond_m = self.beyond_m.item(index)
        left_m = abs(beyond_m - self.late.expected_m)
        if self.told[index] and left_m > FOOT_DISTANCE_STDS * self.std_m[index]:
            return (_contradiction(beyond_m),)
        if self.high[index]:
            return (
                "the felling cut comes out so high above the ground that the depth may be of"
                " something in front of the stem",
            )
        if self.late.size_m > MIN_LATE_SHIFT_M:
            side = "in front of" if self.late.beyond_m > 0 else "behind"
            return (
                f"the feet of the stems meet the ground {abs(self.late.beyond_m):.2f} m {side}"
                f" their depth: the depth may be of an earlier moment{self._corrected()}",
            )
        return ()

    def _corrected(self) -> str:
        shift_m = self.late.expected_m
        return f", and distances are corrected by {-shift_m:+.2f} m" if shift_m else ""

    def failure(self, index: int, distance_m: float) -> str | None:
        """Why the depth of one stem cannot be the stem's, or None."""
        beyond_m = self.beyond_m.item(index)
        if not (self.told[index] and abs(beyond_m) > MAX_RELATIVE_STD * distance_m):
            return None
        return f"no depth on the stem: {_contradiction(beyond_m)}"

    def turn_stds_rad(self, lever_m: Float) -> Float:
        """(T,) standard deviations of a turn of the axes, in radians.

        Readings of something else, such as a branch, move the axis and turn it around their middle.
        Least squares share the difference at the foot between the move and the turn.

        Args:
            lever_m: (T,) length along the axis from the foot to the middle of the readings.
        """
        return np.asarray(self.own_doubt_m * lever_m / (lever_m**2 + MOVED_BY_TURN_M**2))


def _contradiction(beyond_m: float) -> str:
    """How the depth of a stem contradicts its foot, and what is likely to have caused it."""
    if beyond_m > 0:
        return (
            f"the foot of the stem meets the ground {beyond_m:.2f} m in front of its depth, which"
            " may be of an earlier moment or of something behind"
        )
    return (
        f"the foot of the stem meets the ground {-beyond_m:.2f} m behind its depth, which may be of"
        " something in front or of an earlier moment"
    )


def foot_distances(
    frame: DepthFrame,
    outline: Outline,
    bases: StemBases,
    grounds: Sequence[BaseGround | Failure],
    along: Float,
    stem_std_m: Float,
    cut_std_m: Float,
) -> FootDistances:
    """Compare the distances of T stems with those of their feet.

    A foot is seen where the readings just below its mask lie on the ground's plane. Where they lie
    above it, plants may hide the foot. A stem nearer than its foot contradicts it only if these
    readings are further away than the stem: a mask that ends too early moves the foot back. All
    feet together, and those below which the depth shows the stem going on, tell whether the depth
    is of an earlier moment.

    Args:
        frame: Depth, camera and masks.
        outline: Outlines of the stems.
        bases: The lower ends of the stems.
        grounds: Ground at each stem.
        along: (T, 3) unit vectors up the axes.
        stem_std_m: (T,) standard deviations of the stems' distances at their feet.
        cut_std_m: (T,) standard deviations of the felling cuts along the axes; NaN where no
            keypoint tells it.
    """
    normals, offsets_m, std_m, above = _planes(grounds, bases.feet)
    below_m, behind_m = below_feet(
        frame, outline.regions, outline.depth_shift_px, bases, normals, offsets_m
    )
    feet = bases.feet
    height_m = np.vecdot(feet, normals) + offsets_m
    fall_m = np.maximum(offsets_m - height_m, _MIN_FALL * offsets_m)
    # Metres of distance for each metre of height, along the ray.
    per_height = np.linalg.norm(feet, axis=1) / fall_m
    beyond_m = -per_height * height_m
    butt_std_m = frame.settings.butt_swell * bases.radii_m
    heights_std_m = np.sqrt(std_m**2 + bases.feet_std_m**2 + UNEVEN_STD_M**2 + LITTER_STD_M**2)
    total_m = np.sqrt((per_height * heights_std_m) ** 2 + stem_std_m**2 + butt_std_m**2)
    on_ground = bases.foot_within & (np.abs(below_m) < 3 * UNEVEN_STD_M)
    # Where the image cuts a stem, its foot is even nearer.
    cut = (bases.feet_px[:, 1] > frame.camera.height - bases.feet_std_px) & (beyond_m > 0)
    known = (offsets_m > 0) & np.isfinite(beyond_m) & np.isfinite(total_m)
    seen = (on_ground | cut) & known
    told = seen & ((beyond_m > 0) | (behind_m > feet[:, 2]))
    down_m = height_m / np.maximum(np.vecdot(normals, along), _MIN_COSINE)
    short = known & bases.foot_within & (beyond_m < -total_m)
    goes_on = np.zeros_like(short)
    if short.any():
        way_m = -down_m[short, None] * along[short]
        regions, shift_px = outline.regions.of(short), outline.depth_shift_px[short]
        goes_on[short] = goes_on_below(frame, regions, shift_px, bases.of(short), way_m)
    # Nothing that hides a foot moves it in front of the depth.
    in_front = known & bases.foot_within & np.isnan(below_m) & (beyond_m > 0)
    telling = seen | goes_on | in_front
    beside = bool(2 * np.count_nonzero(outline.depth_shift_px) >= len(feet))
    other = np.minimum(OTHER_FOOT_SHARE + above, _MAX_OTHER)
    late = late_depth(beyond_m[telling], total_m[telling], other[telling], beside)
    # What the difference shows beyond its standard deviation, as in Birge's ratio, and what of it
    # is left after the correction.
    excess_m, left_m = (
        np.where(told, np.sqrt(np.maximum(each**2 - total_m**2, 0.0)), 0.0)
        for each in (beyond_m, beyond_m - late.expected_m)
    )
    high_m = _high_cuts(bases, normals, offsets_m, np.hypot(std_m, cut_std_m), stem_std_m)
    excess_m, left_m = np.maximum(excess_m, high_m), np.maximum(left_m, high_m)
    return FootDistances(
        beyond_m=np.where(seen, beyond_m, np.nan),
        std_m=total_m,
        told=told,
        late=late,
        doubt_m=np.maximum(left_m, late.std_m),
        own_doubt_m=np.sqrt(np.maximum(excess_m**2 - late.size_m**2, 0.0)),
        high=high_m > 0,
    )


def _high_cuts(
    bases: StemBases, normals: Float, offsets_m: Float, std_m: Float, stem_std_m: Float
) -> Float:
    """How much further T stems are if their felling cuts are as high above the ground as usual.

    A cut that is higher by more than `FOOT_DISTANCE_STDS` standard deviations shows that the depth
    may be of something in front of the stem, such as another one that is in its mask. The result is
    at most `MAX_RELATIVE_STD` of the distance.

    Args:
        bases: The lower ends of the stems.
        normals: (T, 3) of the ground.
        offsets_m: (T,) heights of the camera above it; 0 where there is none.
        std_m: (T,) standard deviations of the heights of ground and cut.
        stem_std_m: (T,) standard deviations of the stems' distances.

    Returns:
        (T,) what the differences show beyond that, 0 where nothing does.
    """
    height_m = np.vecdot(bases.cuts, normals) + offsets_m
    fall_m = np.maximum(offsets_m - height_m, _MIN_FALL * offsets_m)
    known = (offsets_m > 0) & np.isfinite(std_m) & np.isfinite(height_m)
    per_height = np.where(known, np.linalg.norm(bases.cuts, axis=1) / np.where(known, fall_m, 1), 0)
    higher_m = np.maximum(np.where(known, height_m, 0.0) - CUT_ABOVE_GROUND_M, 0.0)
    usual_m = np.sqrt(std_m**2 + CUT_ABOVE_GROUND_STD_M**2 + UNEVEN_STD_M**2)
    total_m = np.hypot(per_height * usual_m, stem_std_m)
    squares = (per_height * higher_m) ** 2 - (FOOT_DISTANCE_STDS * total_m) ** 2
    most_m = MAX_RELATIVE_STD * np.linalg.norm(bases.cuts, axis=1)
    return np.where(known, np.clip(np.sqrt(np.maximum(squares, 0.0)), 0.0, most_m), 0.0)


def _planes(
    grounds: Sequence[BaseGround | Failure], feet: Float
) -> tuple[Float, Float, Float, Float]:
    """Normals (T, 3) of the ground, heights (T,) of the camera above it, its deviations (T,), and
    the shares (T,) of points that stand above it.
    """
    count = len(grounds)
    normals, (offsets_m, std_m, above) = np.zeros((count, 3)), np.zeros((3, count))
    for index, ground in enumerate(grounds):
        ground = ground.ground if isinstance(ground, DistrustedGround) else ground
        if isinstance(ground, BaseGround):
            normals[index] = ground.plane.normal
            offsets_m[index] = ground.plane.offset_m + ground.lift_m
            std_m[index] = float(ground.plane.height_std_m(feet[index]))
            above[index] = ground.plane.above_fraction
    return normals, offsets_m, std_m, above
