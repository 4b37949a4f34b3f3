"""The ground around a stem's base, and heights above it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import GroundPlane, GroundPlaneFailure, fit_ground_plane
from edgetree.measure.estimates import Estimate, Failure
from edgetree.measure.settings import MeasureSettings

__all__ = ["GROUND_REACHES_M", "BaseGround", "fit_base_ground"]

Float = NDArray[np.floating[Any]]

# Ground is looked for this far around the stem; only where that is hidden, further away, since
# the ground is no plane and heights err with the distance.
GROUND_REACHES_M = (0.6, 1.4)
# How far above and below the felling cut ground may lie.
_ABOVE_CUT_M = 0.3
_BELOW_CUT_M = 1.5
_MOST_POINTS = 400
_TOLERANCE_M = 0.05
# The plane is never known better: litter, moss and roots lie on it.
_LITTER_STD_M = 0.02
# Points of one patch err together; so many points count as one.
_POINTS_PER_READING = 8.0
_LEAST_MEETING = 0.2


@dataclass(frozen=True, eq=False)
class BaseGround:
    """The ground plane at a stem, and the vertical that heights are taken along.

    Attributes:
        plane: fitted to the depth around the base.
        up: (3,) unit vector away from gravity, in the camera's frame.
    """

    plane: GroundPlane
    up: Float

    def cut_height_m(
        self, axis_point: Float, along: Float, radius_m: float, axis_std_m: float
    ) -> Estimate | Failure:
        """Height of a point (3,) of the axis above the ground on the stem's uphill side.

        The axis, (3,) unit `along`, is followed to the ground; there the ground rises by the
        radius times its slope towards the uphill side.
        """
        normal = self.plane.normal
        steepness = float(normal @ self.up)
        meeting = float(normal @ along)
        if meeting < _LEAST_MEETING:
            return Failure("the stem lies along the ground")
        length = float(self.plane.height_m(axis_point)) / meeting
        uphill = radius_m * float(np.sqrt(max(1 - steepness**2, 0.0))) / steepness
        value = length * float(along @ self.up) - uphill
        plane_std = self.plane.residual_std_m / np.sqrt(
            max(self.plane.points / _POINTS_PER_READING, 1.0)
        )
        return Estimate(value, float(np.sqrt(plane_std**2 + _LITTER_STD_M**2 + axis_std_m**2)))


def fit_base_ground(
    points: Float,
    axis_point: Float,
    reach_m: float,
    up: Float | None,
    settings: MeasureSettings,
) -> BaseGround | Failure:
    """Fit the ground to (N, 3) camera points outside the stems, near a stem's axis at its cut.

    Args:
        points: camera points near the base in the picture.
        axis_point: (3,) on the axis at the felling cut.
        reach_m: points within this distance of the axis are taken.
        up: (3,) the vertical; None takes the plane's normal for it.
        settings: the steepest slope that is ground.
    """
    vertical = np.array([0.0, -1.0, 0.0]) if up is None else up
    offset = points - axis_point
    rise = offset @ vertical
    level = np.linalg.norm(offset - rise[:, None] * vertical, axis=1)
    near = (level < reach_m) & (rise < _ABOVE_CUT_M) & (rise > -_BELOW_CUT_M)
    chosen = points[near]
    chosen = chosen[:: max(1, len(chosen) // _MOST_POINTS)]
    plane = fit_ground_plane(chosen, vertical, settings.max_slope_deg, _TOLERANCE_M)
    if isinstance(plane, GroundPlaneFailure):
        return Failure(f"no ground around the base: {plane.reason}")
    return BaseGround(plane, plane.normal if up is None else vertical)
