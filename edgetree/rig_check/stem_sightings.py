"""The stems that are seen during a drive, as landmarks: which stem, where, and its axis."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from basetree.arrays import Float
from calib.directions import level_rotation
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import find_trees, has_image_for, measure_frame
from edgetree.frames.rig import Rig
from edgetree.live.tracking import StemTracker
from edgetree.measure import EXACT_RIG, Failure, MeasureSettings, StemAxis

if TYPE_CHECKING:
    from edgetree.runtime.detector import TreeDetector

# So wide that the given vertical, which is to be checked, has no weight in the axes.
_LEAN_STD_DEG: Final = 30.0


@dataclass(frozen=True, eq=False)
class Sighting:
    """A stem in one frame.

    Attributes:
        stem: Number of the stem.
        axis: Its axis in the camera's frame.
        frame: The frame, without its images.
    """

    stem: int
    axis: StemAxis
    frame: Frame


class StemFinder:
    """Finds, measures and follows the stems of the frames that it is given, in order.

    Attributes:
        sightings: What it found so far.
    """

    def __init__(self, detector: TreeDetector, rig: Rig) -> None:
        self._detector = detector
        # The rig is what is checked, so its errors are no excuse.
        self._rig = Rig(mounting=rig.mounting, rotation_deg=rig.rotation_deg, uncertainty=EXACT_RIG)
        self._settings = MeasureSettings(lean_std_deg=_LEAN_STD_DEG)
        self._tracker = StemTracker()
        self.sightings: list[Sighting] = []

    def add(self, frame: Frame) -> None:
        """Find the stems of one more frame with colour, depth, camera and without a fault."""
        if (
            not has_image_for(self._detector, frame)
            or frame.depth_m is None
            or frame.camera is None
        ):
            return
        found = find_trees(frame, self._detector, self._rig)
        measured = measure_frame(frame, found, self._rig, self._settings).measurements or []
        trees = found.trees
        tracks = self._tracker.update(frame, trees, measured)
        bare = replace(frame, image=None, depth_m=None)
        for track in tracks:
            axis = None if track.tree is None else measured[track.tree].axis
            if axis is not None and not isinstance(axis, Failure):
                self.sightings.append(Sighting(track.number, axis, bare))


def level_axes(sightings: list[Sighting], ups: Float) -> tuple[Float, Float, Float, Float]:
    """The axes in level frames (x ahead of the camera, y left, z up).

    Args:
        sightings: N sightings.
        ups: (N, 3) verticals of their frames, which level them.

    Returns:
        (N, 3) points, (N, 3) directions, and (N, 3, 3) the covariances of each.
    """
    level = np.array([level_rotation(up) for up in ups])
    turned = level.transpose(0, 2, 1)
    point = np.array([each.axis.point_m for each in sightings])
    direction = np.array([each.axis.direction for each in sightings])
    point_cov = np.array([each.axis.point_covariance_m2 for each in sightings])
    turn_cov = np.array([each.axis.direction_covariance for each in sightings])
    return (
        np.einsum("nij,nj->ni", level, point),
        np.einsum("nij,nj->ni", level, direction),
        level @ point_cov @ turned,
        level @ turn_cov @ turned,
    )
