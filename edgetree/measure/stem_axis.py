"""The line of a stem's axis with its uncertainty, for following the stem over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["StemAxis"]


@dataclass(frozen=True, eq=False, kw_only=True)
class StemAxis:
    """The line of a stem's axis in camera coordinates (x right, y down, z forward).

    Attributes:
        point_m: (3,) axis point at the felling cut; if the cut is not known, axis point of the
            section at which the diameter is measured.
        point_covariance_m2: (3, 3) covariance of its error.
        direction: (3,) unit vector up the axis.
        direction_covariance: (3, 3) covariance of its error, rad².
    """

    point_m: NDArray[np.floating[Any]]
    point_covariance_m2: NDArray[np.floating[Any]]
    direction: NDArray[np.floating[Any]]
    direction_covariance: NDArray[np.floating[Any]]
