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
from edgetree.measure.constants.ground import (
    FOOT_DISTANCE_STDS,
    LITTER_STD_M,
    MIN_BELOW_FOOT_SHARE,
    UNEVEN_STD_M,
)
from edgetree.measure.constants.stems import MAX_RELATIVE_STD
from edgetree.measure.edge_lines import masked_medians
from edgetree.measure.estimates import Failure
from edgetree.measure.frame import DepthFrame
from edgetree.measure.ground import BaseGround, DistrustedGround, StemBases
from edgetree.measure.regions import SearchRegions

# The ground below the end of a mask is read at these distances, in standard deviations of that end
# but in pixels at least, and at these places across, in half widths of the stem.
_BELOW = np.linspace(2.5, 5.0, 6)
_ACROSS = np.linspace(-0.6, 0.6, 5)
# The ray meets the ground where it falls by this share of the camera's height at least.
_MIN_FALL = 0.1


class FootDistances(NamedTuple):
    """How far T stems are from where their feet meet the ground, as seen from the camera.

    Attributes:
        beyond_m: (T,) distance by the depth less that by the foot; NaN where no foot is seen.
        std_m: (T,) its standard deviation.
        doubt_m: (T,) standard deviations to add to those of the distances; 0 where both agree
            within their deviations, or nothing tells.
        shared_m: By how much most stems of the frame are beyond their feet; 0 where this is within
            `FOOT_DISTANCE_STDS`, or only one is seen.
    """

    beyond_m: Float
    std_m: Float
    doubt_m: Float
    shared_m: float

    def warning(self, index: int) -> tuple[str, ...]:
        """What the foot of one stem, or those of the others, tells of its depth."""
        beyond_m = self.beyond_m.item(index)
        if self.doubt_m[index] and abs(beyond_m) > FOOT_DISTANCE_STDS * self.std_m[index]:
            return (_contradiction(beyond_m),)
        if self.shared_m:
            return (
                f"the feet of the stems meet the ground {self.shared_m:.2f} m in front of their"
                " depth: the depth may be of an earlier moment",
            )
        return ()

    def failure(self, index: int, distance_m: float) -> str | None:
        """Why the depth of one stem cannot be the stem's, or None."""
        beyond_m = self.beyond_m.item(index)
        if not (self.doubt_m[index] and abs(beyond_m) > MAX_RELATIVE_STD * distance_m):
            return None
        return f"no depth on the stem: {_contradiction(beyond_m)}"


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
    regions: SearchRegions,
    bases: StemBases,
    grounds: Sequence[BaseGround | Failure],
    stem_std_m: Float,
) -> FootDistances:
    """Compare the distances of T stems with those of their feet.

    A foot is seen where the readings just below its mask lie on the ground's plane. Where they lie
    above it, plants may hide the foot. A stem nearer than its foot contradicts it only if these
    readings are further away than the stem: a mask that ends too early moves the foot back.

    Args:
        frame: Depth, camera and masks.
        regions: Search regions along the stems.
        bases: The lower ends of the stems.
        grounds: Ground at each stem.
        stem_std_m: (T,) standard deviations of the stems' distances at their feet.
    """
    normals, offsets_m, std_m = _planes(grounds, bases.feet)
    below_m, behind_m = _below_feet(frame, regions, bases, normals, offsets_m)
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
    seen = (on_ground | cut) & (offsets_m > 0) & np.isfinite(beyond_m) & np.isfinite(total_m)
    told = seen & ((beyond_m > 0) | (behind_m > feet[:, 2]))
    shared_m = _shared_m(beyond_m[seen], total_m[seen])
    # What the difference shows beyond its standard deviation, as in Birge's ratio.
    excess_m = np.sqrt(np.maximum(beyond_m**2 - total_m**2, 0.0))
    return FootDistances(
        beyond_m=np.where(seen, beyond_m, np.nan),
        std_m=total_m,
        doubt_m=np.maximum(np.where(told, excess_m, 0.0), shared_m),
        shared_m=shared_m,
    )


def _shared_m(beyond_m: Float, std_m: Float) -> float:
    """By how much most of N stems are beyond their feet; 0 where they agree, or for one stem.

    It is their median. Of two middle values the one nearer to 0 counts, so that one stem with the
    depth of something else moves no other.
    """
    count = len(beyond_m)
    if count < 2:
        return 0.0
    middle = np.argsort(beyond_m)[(count - 1) // 2]
    within_m = FOOT_DISTANCE_STDS * std_m[middle] / np.sqrt(count)
    return float(beyond_m[middle]) if beyond_m[middle] > within_m else 0.0


def _planes(grounds: Sequence[BaseGround | Failure], feet: Float) -> tuple[Float, Float, Float]:
    """Normals (T, 3) of the ground, heights (T,) of the camera above it, its deviations (T,)."""
    count = len(grounds)
    normals, offsets_m, std_m = np.zeros((count, 3)), np.zeros(count), np.zeros(count)
    for index, ground in enumerate(grounds):
        ground = ground.ground if isinstance(ground, DistrustedGround) else ground
        if isinstance(ground, BaseGround):
            normals[index] = ground.plane.normal
            offsets_m[index] = ground.plane.offset_m + ground.lift_m
            std_m[index] = float(ground.plane.height_std_m(feet[index]))
    return normals, offsets_m, std_m


def _below_feet(
    frame: DepthFrame,
    regions: SearchRegions,
    bases: StemBases,
    normals: Float,
    offsets_m: Float,
) -> tuple[Float, Float]:
    """Median heights above the ground and depths (T,) of readings just below the masks.

    Both are NaN where too few places have a reading, or the image ends.
    """
    step_px = np.maximum(bases.feet_std_px, 1.0)[:, None]
    down = (_BELOW * step_px)[:, :, None, None] * regions.along[:, None, None]
    across = (_ACROSS * regions.half_px[:, None])[:, None, :, None]
    xy_px = bases.feet_px[:, None, None] - down + across * regions.across[:, None, None]
    count = len(step_px)
    rays, depth_m = frame.readings(np.where(np.isfinite(xy_px), xy_px, -1.0))
    depth_m = depth_m.reshape(count, -1)
    known: Bool = depth_m > 0
    falls = np.matmul(rays.reshape(count, -1, 3), normals[..., None])[..., 0]
    height_m = masked_medians(falls * depth_m + offsets_m[:, None], known)
    enough = known.mean(1) >= MIN_BELOW_FOOT_SHARE
    behind_m = masked_medians(depth_m, known)
    return np.where(enough, height_m, np.nan), np.where(enough, behind_m, np.nan)
