"""A point cloud, and how one is made of the columns or records of a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float
from basetree.files.limits import current_limits
from calib.errors import CloudError

_FARTHEST: Final = 1e8  # more than twice around the Earth, in metres
_XYZ: Final = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points of a laser scanner in one frame.

    Attributes:
        points_m: (N, 3) float64 metres, all finite, N at least 1. Beams without a return are left
            out: points that are not finite, and those at exactly (0, 0, 0).

    Raises:
        CloudError: If there is no point, or the array has another shape or coordinates that no
            place on Earth has.

    Examples:
        >>> from calib.clouds import PointCloud
        >>> PointCloud([[5.0, 0.0, 1.0], [0.0, 0.0, 0.0]]).points_m
        array([[5., 0., 1.]])
    """

    points_m: Float

    def __post_init__(self) -> None:
        given = np.asarray(self.points_m)
        if given.ndim != 2 or given.shape[1] != 3 or given.dtype.kind not in "fiu":
            raise CloudError(f"the points have shape {given.shape} of {given.dtype}: expected Nx3")
        points = given.astype(np.float64)
        returned = np.isfinite(points).all(1) & points.any(1)
        points = points if returned.all() else points[returned]
        if not len(points):
            raise CloudError(f"none of its {len(given)} points has coordinates: expected some")
        farthest = float(np.abs(points).max())
        if farthest > _FARTHEST:
            raise CloudError(
                f"a coordinate is {farthest:g}: expected metres, up to {_FARTHEST:g}; the file may"
                " be of another format"
            )
        points.flags.writeable = False
        object.__setattr__(self, "points_m", points)


def check_count(count: int) -> None:
    """Check a number of points before they are read.

    Raises:
        CloudError: If it is negative or above `Limits.cloud_points`.
    """
    most = current_limits().cloud_points
    if not 0 <= count <= most:
        raise CloudError(f"it has {count} points: expected at most {most}, the limit cloud_points")


def xyz_of_records(records: NDArray[Any]) -> Float:
    """The coordinates (N, 3) of records with fields x, y and z of one number each.

    Raises:
        CloudError: If one of these fields is missing or no number.
    """
    names = records.dtype.names or ()
    by_name = {name.lower(): name for name in reversed(names)}
    missing = [name for name in _XYZ if name not in by_name]
    if missing:
        raise CloudError(f"its points have the fields {list(names)}: expected x, y and z")
    columns = [records[by_name[name]] for name in _XYZ]
    if any(column.ndim != 1 or column.dtype.kind not in "fiu" for column in columns):
        raise CloudError("x, y and z of its points are no single numbers: expected those")
    check_count(len(records))
    return np.stack([column.astype(np.float64) for column in columns], -1)
