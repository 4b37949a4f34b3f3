"""Turn pictures upright, with all that is measured in them, and the results back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from basetree.errors import InputError
from calib import PinholeCamera, RigidTransform
from edgetree.detections import TreeDetections

if TYPE_CHECKING:
    from edgetree.measure import TreeMeasurement

_QUARTER_DEG: Final = 90
_ROTATIONS_DEG: Final = (0, 90, 180, 270)
# A quarter turn clockwise moves what is on the left, -x, to the top, -y.
_QUARTER: Final = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
# The vertical tells that a camera lies on its side if it is in the picture's plane, rather than
# along the optical axis, and nearer to the picture's side than to a corner.
_MIN_IN_PLANE: Final = 0.5
_MIN_SIDEWAYS: Final = float(np.cos(np.radians(40.0)))


@dataclass(frozen=True)
class Turn:
    """A turn clockwise by some quarters, from a camera's pictures to upright ones.

    Attributes:
        quarters: 0 to 3.
    """

    quarters: int = 0

    def __bool__(self) -> bool:
        return self.quarters != 0

    @property
    def back(self) -> Turn:
        """The turn that undoes this one."""
        return Turn(-self.quarters % 4)

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) rotation from the camera's frame to that of the upright camera."""
        return np.linalg.matrix_power(_QUARTER, self.quarters)

    def directions(self, xyz: ArrayLike) -> NDArray[np.float64]:
        """Turn (..., 3) directions or points about the optical axis."""
        return np.asarray(np.asarray(xyz, np.float64) @ self.rotation.T)

    def picture(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Turn (H, W) or (H, W, channels)."""
        return np.ascontiguousarray(np.rot90(pixels, -self.quarters)) if self else pixels

    def points(self, xy_px: ArrayLike, width: int, height: int) -> NDArray[np.float64]:
        """Points (..., 2) of a picture of this size in the turned picture."""
        points = np.asarray(xy_px, np.float64)
        for _ in range(self.quarters):
            points = np.stack([height - points[..., 1], points[..., 0]], -1)
            width, height = height, width
        return points

    def camera(self, camera: PinholeCamera) -> PinholeCamera:
        """The camera of the turned picture."""
        return camera.rotated(self.quarters * _QUARTER_DEG)

    def mounting(self, mounting: RigidTransform) -> RigidTransform:
        """The transform from the frame of the upright camera."""
        return RigidTransform(mounting.rotation @ self.rotation.T, mounting.translation_m)

    def trees(self, trees: TreeDetections) -> TreeDetections:
        """The trees in the turned picture."""
        for _ in range(self.quarters):
            trees = _quarter(trees)
        return trees

    def measurement(self, tree: TreeMeasurement) -> TreeMeasurement:
        """A measurement with its points and directions in the turned camera's frame."""
        from edgetree.measure import PointEstimate, StemAxis, StemProfile

        changed: dict[str, Any] = {}
        if isinstance(tree.cut_point_m, PointEstimate):
            point = tree.cut_point_m
            std_m = point.std_m @ np.abs(self.rotation).T
            changed["cut_point_m"] = PointEstimate(self.directions(point.xyz_m), std_m)
        if isinstance(tree.axis, StemAxis):
            axis = tree.axis
            changed["axis"] = StemAxis(
                point_m=self.directions(axis.point_m),
                point_covariance_m2=self._covariance(axis.point_covariance_m2),
                direction=self.directions(axis.direction),
                direction_covariance=self._covariance(axis.direction_covariance),
            )
        if isinstance(tree.profile, StemProfile):
            edges_m = self.directions(tree.profile.edges_m)
            changed["profile"] = replace(tree.profile, edges_m=edges_m)
        return replace(tree, **changed)

    def _covariance(self, covariance: NDArray[Any]) -> NDArray[np.float64]:
        return np.asarray(self.rotation @ covariance @ self.rotation.T)

    def __str__(self) -> str:
        return f"{self.quarters * _QUARTER_DEG}° clockwise"


def check_rotation(rotation_deg: int | None, name: str) -> None:
    """Raise InputError if a rotation is not by quarters."""
    if rotation_deg is not None and rotation_deg not in _ROTATIONS_DEG:
        raise InputError(f"{name} is {rotation_deg}: expected 0, 90, 180 or 270 degrees clockwise")


def turn_of(rotation_deg: int | None, up_camera: ArrayLike | None) -> Turn:
    """The turn that makes a camera's pictures upright.

    Args:
        rotation_deg: Degrees clockwise, as the user gave them; None if they are not given.
        up_camera: (3,) direction away from gravity in the camera's frame; None if unknown. It tells
            a camera on its side. It does not tell one that is upside down, as directions of gravity
            are given in its place by mistake.
    """
    if rotation_deg is not None:
        return Turn(int(rotation_deg) // _QUARTER_DEG)
    if up_camera is None:
        return Turn()
    up = np.asarray(up_camera, np.float64)
    largest = float(np.abs(up).max())
    if not np.isfinite(largest) or largest == 0:
        return Turn()
    x, y, z = (float(value) for value in up / largest)
    in_plane = math.hypot(x, y)
    is_clear = in_plane >= _MIN_IN_PLANE * math.hypot(x, y, z)
    if not is_clear or abs(x) < _MIN_SIDEWAYS * in_plane:
        return Turn()
    return Turn(1 if x < 0 else 3)


def _quarter(trees: TreeDetections) -> TreeDetections:
    """The trees after a quarter turn clockwise, which moves (x, y) to (height - y, x)."""
    height = trees.image_height
    x0, y0, x1, y1 = trees.boxes_px.T
    keypoints = trees.keypoints_px
    if keypoints is not None:
        x, y, score = np.moveaxis(keypoints, -1, 0)
        keypoints = np.stack([height - y, x, score], axis=-1)
    masks, stds = trees.masks, trees.keypoint_stds_px
    return replace(
        trees,
        boxes_px=np.stack([height - y1, x0, height - y0, x1], axis=-1),
        keypoints_px=keypoints,
        keypoint_stds_px=None if stds is None else stds[..., ::-1].copy(),
        masks=None if masks is None else np.rot90(masks, -1, axes=(1, 2)).copy(),
        image_width=height,
        image_height=trees.image_width,
    )
