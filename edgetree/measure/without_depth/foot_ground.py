"""The ground at a stem whose distance does not come from depth: through its own foot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from basetree.arrays import Float
from calib import GroundPlane
from edgetree.measure.base_ground import BaseGround
from edgetree.measure.estimates import Estimate
from edgetree.measure.vertical import Vertical

# Extents of a plane that is not fitted to points: its height is as certain everywhere.
_ENDLESS_M = 1e6


@dataclass(frozen=True, eq=False, kw_only=True)
class FootGround(BaseGround):
    """A plane through the lowest point at which a stem is seen.

    An error of the stem's distance moves its foot and its cut alike, so that a height has the
    relative error of sizes alone.

    Attributes:
        size_std: Relative standard deviation of lengths at the stem.
    """

    size_std: float

    @classmethod
    def at(
        cls,
        foot_m: Float,
        normal: Float,
        vertical: Vertical,
        foot_std_m: float,
        size_std: float,
        cover: Estimate,
    ) -> FootGround:
        """The ground at a foot.

        Args:
            foot_m: (3,) the lowest point that is seen.
            normal: (3,) normal of the ground.
            vertical: The vertical at the stem.
            foot_std_m: Standard deviation of the foot's height.
            size_std: Relative standard deviation of lengths at the stem.
            cover: Stated height of what hides the ground.
        """
        axes = np.linalg.svd(normal[None])[2][1:]
        plane = GroundPlane(
            normal=normal,
            offset_m=-float(normal @ foot_m),
            residual_std_m=foot_std_m,
            inlier_fraction=1.0,
            above_fraction=0.0,
            points=1,
            independent_points=1.0,
            centre_m=foot_m,
            axes=axes,
            extents_m=np.full(2, _ENDLESS_M),
        )
        return cls(plane=plane, vertical=vertical, size_std=size_std, stated_cover=cover)

    def cut_std_m(self, height_m: float, rise: float, distance_std_m: float, cut_m: float) -> float:
        """As of `BaseGround`; the distance counts by its share of the height alone."""
        return math.hypot(height_m * self.size_std, cut_m)

    def description(self) -> str:
        """As of `BaseGround`."""
        return (
            "through the lowest seen point of the stem, heights along"
            f" {self.vertical.description()}{self._cover_description()}"
        )
