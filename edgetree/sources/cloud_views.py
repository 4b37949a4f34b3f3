"""A point cloud without a picture as a source: depth as virtual cameras in it see it."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from basetree.arrays import Float
from basetree.errors import InputError
from calib import CloudError, PinholeCamera, RigidTransform
from calib.clouds import depth_of_beams, fill_between, grown_across, read_cloud
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.sources.source import BaseSource

_log = logging.getLogger(__name__)

# The virtual camera sees 65 degrees, and looks around in steps that overlap.
_WIDTH, _HEIGHT, _FOCAL_PX = 640, 480, 500.0
_STEP_DEG: Final = 60
# Beams closer together than this, in pixels, leave no gaps: the picture is that of a depth camera.
_DENSE_PX: Final = 2.5
# A place to look from: so far above the ground, on a grid of such cells, with so much room around,
# and with many points between these distances.
_EYE_M, _CELL_M, _ROOM_M = 1.6, 1.0, 1.0
_WITHIN_M: Final = (2.0, 15.0)
_MOST_CELLS, _SAMPLED_POINTS = 2500, 20_000
# The ground is the lowest layer of this height with at least this share of a usual layer's points.
_LAYER_M, _LAYER_SHARE = 0.2, 0.5
# A scan reaches around its scanner: each view has this share of the mean of all views at least. Up
# to this share of its points is on the machine that carries it.
_LEAST_SHARE, _MACHINE_SHARE = 0.1, 0.05


class CloudViews(BaseSource):
    """Views of a cloud whose z axis points up, around one place or from a given camera.

    Args:
        path: The cloud.
        rig: With a camera and `cloud_extrinsics` it is seen by that camera alone. Without both,
            virtual cameras look around from the scanner, or where it is not in the cloud's frame,
            from a free place with many points around.

    Raises:
        InputError: The cloud cannot be read, only one of camera and transform is given, or the rig
            says something of depth images.
    """

    def __init__(self, path: Path, rig: Rig) -> None:
        super().__init__(str(path))
        rig.check_for_clouds(f"cloud {path}")
        if (rig.camera is None) != (rig.cloud_extrinsics is None):
            given, lacks = "--camera", "--extrinsic"
            if rig.camera is None:
                given, lacks = lacks, given
            raise InputError(
                f"{given} given without {lacks} for cloud {path}: expected both, for the view of"
                " that camera, or none for views all around"
            )
        self._path, self._cloud = path, read_cloud(path)
        self._views = [(path.stem, rig.camera, rig.cloud_extrinsics)]
        self._up = None
        if rig.camera is None:
            place_m = viewpoint_m(self._cloud.points_m)
            x, y, z = place_m.tolist()
            _log.warning(
                "cloud %s is seen from x %.1f, y %.1f, z %.1f m, its z axis taken as up; stems"
                " hidden from there or beyond %g m need another place: --camera and --extrinsic",
                *(path, x, y, z, _WITHIN_M[1]),
            )
            camera = PinholeCamera(
                _WIDTH, _HEIGHT, _FOCAL_PX, _FOCAL_PX, _WIDTH / 2 - 0.5, _HEIGHT / 2 - 0.5
            )
            self._up = np.array([0.0, -1.0, 0.0])
            self._views = [
                (
                    f"{path.stem}_yaw{yaw:03d}",
                    camera,
                    RigidTransform.mounting(place_m, yaw_deg=float(yaw)).inverse(),
                )
                for yaw in range(0, 360, _STEP_DEG)
            ]
        self.count = len(self._views)
        self._next = 0

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __next__(self) -> Frame:
        """The next view; views around a place that show hardly any point are passed over."""
        while self._next < len(self._views) and not self._is_closed.is_set():
            name, camera, to_camera = self._views[self._next]
            self._next += 1
            assert camera is not None
            assert to_camera is not None
            try:
                return self._frame(name, camera, to_camera)
            except CloudError as error:
                if len(self._views) == 1:
                    raise CloudError(f"cloud {self._path}: {error}") from error
                _log.warning("view %s shows hardly any point of the cloud: left out", name)
        raise StopIteration

    def _frame(self, name: str, camera: PinholeCamera, to_camera: RigidTransform) -> Frame:
        beams = depth_of_beams(self._cloud, camera, to_camera)
        filled_m = grown_across(fill_between(beams.depth_m, beams.spacing), beams.spacing)
        is_dense = max(beams.spacing[:2]) <= _DENSE_PX
        return Frame(
            name,
            self._path,
            None,
            filled_m if is_dense else beams.depth_m,
            camera=camera,
            up_camera=self._up,
            pose=to_camera.inverse(),
            filled_depth_m=None if is_dense else filled_m,
            cloud_m=np.asarray(to_camera.apply(self._cloud.points_m), np.float64),
        )


def viewpoint_m(points_m: Float) -> Float:
    """Where to look around from in a cloud: the scanner, or a free place with many points around.

    Args:
        points_m: (N, 3) points, z up.

    Returns:
        (3,) the frame's origin if the cloud lies all around it and little is near it, as in scans
        in the scanner's frame.
    """
    points = points_m[:: len(points_m) // _SAMPLED_POINTS + 1]
    low, high = points.min(0), points.max(0)
    origin = np.zeros(3)
    if _room_m(points, origin, _MACHINE_SHARE) >= _ROOM_M:
        seen = _seen(points, origin)
        if seen.min() >= _LEAST_SHARE * seen.mean() > 0 and (low < 0).all() and (high > 0).all():
            return origin
    cell_m = max(_CELL_M, math.sqrt(float(np.prod(np.maximum(high - low, 1.0)[:2])) / _MOST_CELLS))
    best: Float = np.append(points[:, :2].mean(0), _ground_m(points[:, 2]) + _EYE_M)
    most = -1.0
    for x in np.arange(low[0] + cell_m / 2, high[0], cell_m):
        for y in np.arange(low[1] + cell_m / 2, high[1], cell_m):
            near = points[np.hypot(points[:, 0] - x, points[:, 1] - y) < 2 * cell_m, 2]
            if not len(near):
                continue
            place = np.array([x, y, _ground_m(near) + _EYE_M])
            # The square root prefers points on all sides to as many on one.
            openness = float(np.sqrt(_seen(points, place)).sum())
            if openness > most and _room_m(points, place) >= _ROOM_M:
                best, most = place, openness
    return best


def _seen(points: Float, place: Float) -> Float:
    """How many points lie in the direction of each view (6,), at distances that it can measure."""
    x, y = (points[:, :2] - place[:2]).T
    apart_m = np.hypot(x, y)
    within = (apart_m > _WITHIN_M[0]) & (apart_m < _WITHIN_M[1])
    yaw = np.rint(np.degrees(np.arctan2(y[within], x[within])) / _STEP_DEG).astype(np.intp)
    count = 360 // _STEP_DEG
    return np.bincount(yaw % count, minlength=count).astype(np.float64)


def _ground_m(heights_m: Float) -> float:
    """The lowest layer that holds as many points as layers do: ground, or the feet of stems.

    Points below it are errors. A quantile would lie high up the stems where the ground has been
    removed.
    """
    low = float(heights_m.min())
    layers = np.bincount(((heights_m - low) / _LAYER_M).astype(np.intp))
    usual = float(np.median(layers[layers > 0]))
    first = int(np.argmax(layers >= _LAYER_SHARE * usual))
    return low + first * _LAYER_M


def _room_m(points: Float, place: Float, but_for: float = 0.001) -> float:
    """Distance from a place to the nearest points, but for a share of them."""
    apart_m = np.linalg.norm(points - place, axis=1)
    few = min(int(but_for * len(apart_m)), len(apart_m) - 1)
    return float(np.partition(apart_m, few)[few])
