"""Distances of stems from the camera's height above the ground and the pixel of their foot.

The ray r to the foot meets the ground, a plane with the unit normal n at the distance h below the
camera, at r h / (-n r). Its part along the horizontal direction v of the stem is the front range of
the bark, from which the width follows as with depth. The relative error of the range is, to first
order, the change of ln(v r) - ln(-n r) + ln h.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from basetree.arrays import Float
from basetree.errors import InputError
from calib.directions import heading, unit
from edgetree.measure.constants.placing import (
    CAMERA_HEIGHT_STD,
    GROUND_SLOPE_STD_DEG,
    RELIEF_STD_M,
    ROOT_FLARE_STD,
)
from edgetree.measure.without_depth.placement import Placement, SeenStems, largest_terms

_LARGEST_SLOPE_DEG = 45.0
_LARGEST_HEIGHT_M = 50.0
# A foot less than this below the horizon, as a tangent, tells no distance.
_LEAST_BELOW = 1e-3


class _Feet(NamedTuple):
    """The feet of T stems on the ground.

    Attributes:
        rays: (T, 3) rays to them.
        normals: (T, 3) normals of the ground.
        fall: (T,) by how much each ray falls towards the ground.
        below: (T,) the same, at least `_LEAST_BELOW`.
        height_m: (T,) height of the camera above the foot, along the normal.
    """

    rays: Float
    normals: Float
    fall: Float
    below: Float
    height_m: Float


@dataclass(frozen=True)
class CameraHeight:
    """The camera's height above ground that is level, or slopes as given.

    Attributes:
        height_m: Height of the camera above the ground below it, along the vertical.
        height_std_m: Its standard deviation; None for 3 % of it.
        ahead_deg: Slope of the ground ahead of the camera, positive where it rises.
        right_deg: Slope to the right, likewise.
        slope_std_deg: Standard deviation of both.

    Raises:
        InputError: A value is not finite or out of range.
    """

    height_m: float
    height_std_m: float | None = None
    ahead_deg: float = 0.0
    right_deg: float = 0.0
    slope_std_deg: float = GROUND_SLOPE_STD_DEG

    def __post_init__(self) -> None:
        if not 0 < self.height_m <= _LARGEST_HEIGHT_M:
            raise InputError(
                f"the camera's height is {self.height_m:g}: expected metres above 0, up to"
                f" {_LARGEST_HEIGHT_M:g}"
            )
        std_m = self.height_std_m
        if std_m is not None and not 0 <= std_m < self.height_m:
            raise InputError(
                f"the deviation of the camera's height is {std_m:g}: expected 0 or more metres,"
                " and less than the height"
            )
        for value in (self.ahead_deg, self.right_deg):
            if not abs(value) <= _LARGEST_SLOPE_DEG:
                raise InputError(
                    f"the slope of the ground is {value:g}: expected degrees from"
                    f" -{_LARGEST_SLOPE_DEG:g} to {_LARGEST_SLOPE_DEG:g}"
                )
        if not 0 <= self.slope_std_deg <= _LARGEST_SLOPE_DEG:
            raise InputError(
                f"the deviation of the ground's slope is {self.slope_std_deg:g}: expected degrees"
                f" from 0 to {_LARGEST_SLOPE_DEG:g}"
            )

    @property
    def relative_std(self) -> float:
        """Relative standard deviation of the height."""
        if self.height_std_m is None:
            return CAMERA_HEIGHT_STD
        return self.height_std_m / self.height_m

    def normal(self, up: Float) -> Float:
        """(3,) normal of the ground below a camera with the vertical `up` (3,)."""
        ahead = unit(heading(up))
        right = np.cross(ahead, up)
        slope = math.tan(math.radians(self.ahead_deg)) * ahead
        return unit(up - slope - math.tan(math.radians(self.right_deg)) * right)

    def place(self, seen: SeenStems) -> Placement:
        """Place stems by the pixels of their feet; see `SeenStems`."""
        foot = self._feet(seen)
        ahead, sections = seen.sections.view_direction, seen.sections
        reach = np.vecdot(foot.rays, ahead)
        distance_m = reach * foot.height_m / foot.below / sections.front_ratio
        # Change of the logarithm of the range with the ray.
        change = ahead / reach[:, None] + foot.normals / foot.below[:, None]
        terms = self._terms(seen, foot, change)
        own = np.linalg.norm(list(terms.values()), axis=0)
        # The distance is the inverse of a tangent with these relative errors, to second order.
        own = own * np.sqrt(1 + 8 * np.minimum(own, 1.0) ** 2)
        rig_focal, focal = seen.frame.rig.focal, -np.vecdot(foot.rays[:, :2], change[:, :2])
        terms["the focal length (--camera)"] = rig_focal * np.abs(focal - 1)
        reasons = [
            self._reason(*each)
            for each in zip(
                seen.foot_within.tolist(), foot.fall.tolist(), reach.tolist(), strict=True
            )
        ]
        level = not (self.ahead_deg or self.right_deg)
        ground = "level ground" if level else "ground of the given slope"
        feet_m = np.vecdot(foot.rays, sections.axes.along) * foot.height_m / foot.below
        return Placement(
            distance_m=distance_m,
            distance_std=np.hypot(own, rig_focal * focal),
            size_std=np.hypot(own, rig_focal * (focal - 1)),
            anchor_m=feet_m - distance_m * sections.height_ratio,
            normal=foot.normals,
            reasons=reasons,
            words=[f"the camera's height above {ground}"] * len(seen),
            doubts=largest_terms(terms),
        )

    def _feet(self, seen: SeenStems) -> _Feet:
        normals = np.array([self._normal_in(seen, up) for up in seen.up]).reshape(-1, 3)
        rays = seen.frame.rays(np.where(np.isfinite(seen.foot_px), seen.foot_px, 0.0))
        fall = -np.vecdot(rays, normals)
        height_m = self.height_m * np.vecdot(normals, seen.up)
        height_m = height_m - np.minimum(seen.foot_above_m, height_m / 2)
        return _Feet(rays, normals, fall, np.maximum(fall, _LEAST_BELOW), height_m)

    def _terms(self, seen: SeenStems, foot: _Feet, change: Float) -> dict[str, Float]:
        """(T,) relative errors of the range by what they come from."""
        rays, below, height_m = foot.rays, foot.below, foot.height_m
        step = seen.along_px * seen.foot_std_px[:, None]
        moved = np.vecdot(seen.frame.rays(seen.foot_px + step) - rays, change)
        tilt = np.vecdot(rays, np.matmul(seen.up_covariance, rays[..., None])[..., 0])
        level = np.sqrt(np.maximum(np.vecdot(rays, rays) - foot.fall**2, 0.0))
        sections, relief_m = seen.sections, np.hypot(RELIEF_STD_M, seen.foot_above_std_m)
        ray_std = seen.frame.rig.ray * np.linalg.norm(change[:, :2], axis=1)
        return {
            "the camera's height (--camera-height)": np.full_like(below, self.relative_std),
            "the slope of the ground (--ground-slope)": (
                math.radians(self.slope_std_deg) * level / below
            ),
            "the vertical (--up)": np.sqrt(np.maximum(tilt, 0.0)) / below,
            "the pixel of the foot": np.abs(moved),
            "humps of the ground": relief_m / height_m,
            "the principal point (--camera)": ray_std,
            "the roots": ROOT_FLARE_STD * np.sin(sections.half_rad) / sections.front_ratio,
        }

    def _normal_in(self, seen: SeenStems, up: Float) -> Float:
        """(3,) normal in the frame's axes; the slope is that ahead of the camera itself."""
        frame = seen.frame
        return np.asarray(frame.from_camera(self.normal(frame.to_camera(up))))

    @staticmethod
    def _reason(within: bool, fall: float, reach: float) -> str | None:
        if not within or not math.isfinite(fall):
            return "the foot of the stem is not in the picture, from which its distance would come"
        if fall < _LEAST_BELOW or reach <= 0:
            return (
                "the foot of the stem is at or above the horizon: the camera's height is of no use"
                " with this vertical or slope"
            )
        return None
