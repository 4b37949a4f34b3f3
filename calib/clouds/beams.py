"""A point cloud in the picture of a camera: the depth of its beams, and which of them it sees."""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np

from basetree.arrays import Bool, Float, Float32
from calib.camera import PinholeCamera
from calib.clouds.cloud import PointCloud
from calib.errors import CloudError
from calib.points import pixels_to_rays, project_points
from calib.transform import RigidTransform

# A cloud half of whose points in the picture are farther away is in another unit.
_FARTHEST_MEDIAN_M: Final = 500.0
# A point this near to the camera is one of the machine.
_NEAREST_M: Final = 0.2
# Readings belong to one surface if their inverse depths differ by less than this share.
_SAME_SURFACE: Final = 0.1
# A surface hides what is behind it by more than this, in metres and as a share of the distance.
_BEHIND_M, _BEHIND_SHARE = 0.15, 0.03
# The spacing of beams in rows of this height, and this quantile of the gaps up and down, tell how
# far a surface goes on between two beams; within these limits.
_ROW_PX, _GAP_QUANTILE = 2, 0.8
_GAP_MARGIN: Final = 1.5
_MOST_ACROSS_PX, _MOST_DOWN_PX = 24.0, 120.0
_LEAST_GAP_PX: Final = 0.5
_LEAST_APART, _LEAST_GROWTH = 1.3, 0.4
_LEAST_BEAMS: Final = 20
_LENS_MARGIN: Final = 1.05


class Spacing(NamedTuple):
    """Distances between neighbouring beams of one surface in a picture.

    Those of one scan are nearly the same in pixels at all depths. Clouds of several scans have
    points at equal distances in space, so that they lie further apart on near surfaces.

    Attributes:
        across_px, down_px: Distances in pixels at `at_m`.
        at_m: A depth in the middle of the cloud.
        growth: 0 for the same distance in pixels at all depths, 1 for the same in metres.
    """

    across_px: float
    down_px: float
    at_m: float = 1.0
    growth: float = 0.0

    def factor(self, depth_m: Float) -> Float:
        """How much further apart beams are at depths (...) in metres."""
        return np.asarray((self.at_m / depth_m) ** self.growth)


class BeamDepth(NamedTuple):
    """Depth of the beams of a cloud in a camera's picture.

    Attributes:
        depth_m: (H, W) float32 metres along z, 0 where there is no beam.
        spacing: Distances between the beams.
        seen: Number of beams that the camera sees.
        hidden: Number of beams within the picture that nearer surfaces hide from the camera.
    """

    depth_m: Float32
    spacing: Spacing
    seen: int
    hidden: int


def depth_of_beams(
    cloud: PointCloud, camera: PinholeCamera, cloud_to_camera: RigidTransform
) -> BeamDepth:
    """Project a cloud into a camera's picture, without beams that the camera does not see.

    Scanner and camera are at different places, so that beams may go past a near stem to what is
    behind it in the camera's picture. Such a beam lies between beams of a nearer surface above and
    below it, and is left out. Of several beams in a pixel the nearest is taken. Nothing is filled
    in.

    Args:
        cloud: The points.
        camera: The camera, with or without distortion.
        cloud_to_camera: Transform from the cloud's frame to the camera's.

    Raises:
        CloudError: If hardly any point is in the picture; the message says whether the inverse
            transform would bring more. If the points are too far away for metres.

    Examples:
        >>> import numpy as np
        >>> from calib import PinholeCamera, RigidTransform
        >>> from calib.clouds import PointCloud, depth_of_beams
        >>> camera = PinholeCamera(64, 48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)
        >>> wall = PointCloud([[x / 9, y / 9, 3.0] for x in range(-9, 9) for y in range(-9, 9)])
        >>> depth_of_beams(wall, camera, RigidTransform.identity()).seen
        324
    """
    points, xy_px = _in_picture(cloud, camera, cloud_to_camera)
    if len(points) < _LEAST_BEAMS:
        raise CloudError(_few(cloud, camera, cloud_to_camera, len(points)))
    depth_m = points[:, 2]
    median_m = float(np.median(depth_m))
    if median_m > _FARTHEST_MEDIAN_M:
        raise CloudError(
            f"half of its points in the picture are more than {median_m:.0f} m away: expected"
            " metres; these may be millimetres, or the transform is for another frame"
        )
    spacing = _spacing(xy_px, depth_m)
    hidden = _hidden(xy_px, depth_m, spacing)
    seen_px, seen_m = xy_px[~hidden].astype(np.intp), depth_m[~hidden]
    order = np.argsort(-seen_m)  # the nearest is written last
    image = np.zeros((camera.height, camera.width), np.float32)
    image[seen_px[order, 1], seen_px[order, 0]] = seen_m[order]
    return BeamDepth(image, spacing, len(seen_m), int(hidden.sum()))


def fill_between(depth_m: Float32, spacing: Spacing) -> Float32:
    """Close the gaps between neighbouring beams of one surface, as a picture for networks.

    Inverse depth is interpolated linearly, as on a plane, first across and then up and down.

    Args:
        depth_m: (H, W) depth of beams, 0 where there is none.
        spacing: Distances between them.

    Returns:
        (H, W) float32 metres, 0 where no surface was hit.
    """
    inverse = np.divide(1.0, depth_m, out=np.zeros(depth_m.shape), where=depth_m > 0)
    inverse = _between(inverse, spacing.across_px, spacing)
    inverse = _between(inverse.T, spacing.down_px, spacing).T
    inverse = _between(inverse, spacing.across_px, spacing)
    filled = np.divide(1.0, inverse, out=np.zeros(inverse.shape), where=inverse > 0)
    return filled.astype(np.float32)


def grown_across(depth_m: Float32, spacing: Spacing) -> Float32:
    """Let surfaces end half a spacing beyond their outermost beams, where they end on the average.

    Args:
        depth_m: (H, W) depth as from `fill_between`.
        spacing: Distances between the beams.

    Returns:
        (H, W) float32 metres; of two surfaces the nearer one grows.
    """
    reach = int(spacing.across_px / 2)
    if not reach:
        return depth_m
    far = np.where(depth_m > 0, depth_m, np.float32(np.inf))
    nearest = cv2.erode(far, np.ones((1, 2 * reach + 1), np.uint8))
    grown = np.where((depth_m > 0) | ~np.isfinite(nearest), depth_m, nearest)
    return np.asarray(grown, np.float32)


def _between(inverse: Float, gap_px: float, spacing: Spacing) -> Float:
    """Interpolate along the rows between readings of one surface that are close enough."""
    place = np.arange(inverse.shape[1])
    known = inverse > 0
    before = np.maximum.accumulate(np.where(known, place, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, place, len(place))[:, ::-1], axis=1)[:, ::-1]
    nearest = np.ceil(_GAP_MARGIN * gap_px * max(float(spacing.factor(1 / inverse.max())), 1.0))
    closed = ~known & (before >= 0) & (after < len(place)) & (after - before <= nearest)
    rows, columns = np.nonzero(closed)
    first, last = before[rows, columns], after[rows, columns]
    start, end = inverse[rows, first], inverse[rows, last]
    same = np.abs(start - end) < _SAME_SURFACE * np.maximum(start, end)
    allowed_px = np.ceil(_GAP_MARGIN * gap_px * spacing.factor(1 / np.maximum(start, end)))
    same &= last - first <= allowed_px
    rows, columns, first, last = rows[same], columns[same], first[same], last[same]
    share = (columns - first) / (last - first)
    result = inverse.copy()
    result[rows, columns] = start[same] + share * (end - start)[same]
    return result


def _in_picture(
    cloud: PointCloud, camera: PinholeCamera, to_camera: RigidTransform
) -> tuple[Float, Float]:
    """The points (N, 3) in the camera's frame that project into its picture, and where (N, 2)."""
    points = to_camera.apply(cloud.points_m)
    points = points[points[:, 2] > _NEAREST_M]
    # The model of a lens may fold directions beyond its field back into the picture.
    size = np.array([camera.width, camera.height])
    border = np.array([[x, y] for x in (0, 0.5, 1) for y in (0, 0.5, 1)]) * size
    widest = _LENS_MARGIN * np.linalg.norm(pixels_to_rays(camera, border)[:, :2], axis=1).max()
    points = points[np.linalg.norm(points[:, :2], axis=1) <= widest * points[:, 2]]
    xy_px = project_points(camera, points)
    inside = ((xy_px >= 0) & (xy_px < size)).all(1)
    return points[inside], xy_px[inside]


def _few(cloud: PointCloud, camera: PinholeCamera, to_camera: RigidTransform, count: int) -> str:
    """What is said of a cloud of which hardly a point is in the picture."""
    total = len(cloud.points_m)
    text = f"{count} of its {total} points are in the camera's picture: expected many"
    inverse = len(_in_picture(cloud, camera, to_camera.inverse())[0])
    if inverse >= max(_LEAST_BEAMS, total // 100):
        return f"{text}; with the inverse of the transform {inverse} are: turn it round"
    return (
        f"{text}; the transform from the scanner's frame to the camera's (x right, y down, z"
        " forward) may lack the rotation between their axes"
    )


def _spacing(xy_px: Float, depth_m: Float) -> Spacing:
    """The distances between neighbouring beams of one surface."""
    gaps_px, _ = _gaps(xy_px[:, 1] / _ROW_PX, xy_px[:, 0], depth_m, _MOST_ACROSS_PX)
    across_px = _quantile(gaps_px, 0.5)
    width_px = max(_GAP_MARGIN * across_px, 1.0)
    gaps_px, at_m = _gaps(xy_px[:, 0] / width_px, xy_px[:, 1], depth_m, _MOST_DOWN_PX)
    if not len(gaps_px):
        return Spacing(across_px, 1.0)
    middle_m = float(np.median(at_m))
    near, far = at_m <= np.quantile(at_m, 1 / 3), at_m >= np.quantile(at_m, 2 / 3)
    rise = _quantile(gaps_px[near], _GAP_QUANTILE) / _quantile(gaps_px[far], _GAP_QUANTILE)
    apart = float(np.median(at_m[far]) / np.median(at_m[near]))
    growth = np.log(rise) / np.log(apart) if apart > _LEAST_APART else 0.0
    # One scan seen from beside itself differs a little with the depth.
    growth = float(np.clip(growth, 0.0, 1.0)) if growth > _LEAST_GROWTH else 0.0
    return Spacing(across_px, _quantile(gaps_px, _GAP_QUANTILE), middle_m, growth)


def _gaps(band: Float, place_px: Float, depth_m: Float, most_px: float) -> tuple[Float, Float]:
    """Gaps (M,) between readings of one surface along bands (N,), in px, and their depths (M,)."""
    band = np.floor(band)
    order = np.lexsort((place_px, band))
    band, place_px, inverse = band[order], place_px[order], 1 / depth_m[order]
    gap_px = np.diff(place_px)
    larger = np.maximum(inverse[1:], inverse[:-1])
    same = (np.diff(band) == 0) & (np.abs(np.diff(inverse)) < _SAME_SURFACE * larger)
    same &= (gap_px <= most_px) & (gap_px >= _LEAST_GAP_PX)
    return gap_px[same], 1 / larger[same]


def _quantile(gaps_px: Float, quantile: float) -> float:
    return float(np.quantile(gaps_px, quantile)) if len(gaps_px) else 1.0


def _hidden(xy_px: Float, depth_m: Float, spacing: Spacing) -> Bool:
    """(N,) whether a point lies behind a nearer surface that shows above and below it."""
    hidden = np.zeros(len(depth_m), np.bool_)
    farthest_m = float(depth_m.max())
    near_m = float(depth_m.min()) if spacing.growth else farthest_m
    while True:
        # Surfaces up to this depth, with the gaps of the nearest ones that are not done yet.
        until_m = min(2 * near_m, farthest_m)
        hidden |= _behind(xy_px, depth_m, depth_m <= until_m, spacing, near_m)
        if until_m >= farthest_m:
            return hidden
        near_m = until_m


def _behind(xy_px: Float, depth_m: Float, front: Bool, spacing: Spacing, near_m: float) -> Bool:
    """(N,) whether points lie behind those of `front` (N,), which are spaced as at `near_m`."""
    factor = float(spacing.factor(np.array(near_m)))
    width_px = max(_GAP_MARGIN * spacing.across_px * factor, 1.0)
    down_px = min(spacing.down_px * factor, _MOST_DOWN_PX)
    height_px = max(down_px / 4, 1.0)
    cells = (xy_px / (width_px, height_px)).astype(np.intp)
    nearest = np.full(cells.max(0)[::-1] + 1, np.inf)
    np.minimum.at(nearest, (cells[front, 1], cells[front, 0]), depth_m[front])
    reach = int(np.ceil(_GAP_MARGIN * down_px / height_px))
    sides = (_nearest_along(nearest, reach, up) for up in (True, False))
    above, below = (side_m[cells[:, 1], cells[:, 0]] for side_m in sides)
    front_m = np.maximum(above, below)
    known = np.isfinite(front_m)
    above, below = (np.where(known, side_m, 0.0) for side_m in (above, below))
    same = known & (np.abs(above - below) < _SAME_SURFACE * front_m)
    return np.asarray(same & (front_m < depth_m * (1 - _BEHIND_SHARE) - _BEHIND_M))


def _nearest_along(nearest: Float, reach: int, up: bool) -> Float:
    """The smallest of `reach` cells above each cell, or below it; infinite where there is none."""
    padded = cv2.copyMakeBorder(nearest, reach, reach, 0, 0, cv2.BORDER_CONSTANT, value=np.inf)
    smallest = cv2.erode(padded, np.ones((reach, 1), np.uint8), anchor=(0, 0))
    count = len(nearest)
    return np.asarray(smallest[:count] if up else smallest[reach + 1 : reach + 1 + count])
