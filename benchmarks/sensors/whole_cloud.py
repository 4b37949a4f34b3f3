"""A whole cloud of a laser scan, seen by virtual cameras as `edgetree run` sees it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from basetree.arrays import Float
from benchmarks.sensors.captures import DATA
from benchmarks.sensors.views import Readings, detector
from calib import RigidTransform
from calib.clouds import read_cloud
from edgetree.frames.pipeline import process
from edgetree.frames.rig import Rig
from edgetree.measure import Estimate, StemProfile, TreeMeasurement
from edgetree.sources.cloud_views import CloudViews

_FOLDER = DATA / "clouds" / "truebelief_artemis_treeiso"
_CLOUD = _FOLDER / "LPine1_demo.laz"
_BREAST_HEIGHT_M = 1.3
# A measured stem is the one whose axis is so near at breast height, and its profile is read so far
# beyond its ends.
_SAME_M, _BEYOND_M = 0.25, 0.1


def whole_cloud(source: str, circles: bool) -> Readings:
    """Diameters at breast height of the stems of the reference; a stem may be in several views.

    Args:
        source: Name of a model.
        circles: Whether circles through the cloud's slices are weighed with the outlines.
    """
    text = (_FOLDER / "views" / "truth.json").read_text(encoding="utf-8")
    stems = json.loads(text)["stems"]
    low = np.append(read_cloud(_CLOUD).points_m[:, :2].min(0), 0.0)
    rig = Rig()
    for frame in CloudViews(_CLOUD, rig):
        seen = frame if circles else replace(frame, cloud_m=None)
        for tree in process(seen, detector(source), rig).measurements or []:
            assert frame.pose is not None
            yield from _matched(tree, frame.pose, low, stems)


def _matched(
    tree: TreeMeasurement, pose: RigidTransform, low: Float, stems: list[dict[str, Any]]
) -> Iterator[tuple[TreeMeasurement, dict[str, Any]]]:
    if not isinstance(tree.profile, StemProfile) or not tree.axis:
        return
    point = pose.apply(tree.axis.point_m) - low
    along = pose.rotate(tree.axis.direction)
    heights_m = pose.apply(tree.profile.edges_m.mean(1))[:, 2]
    order = np.argsort(heights_m)
    for stem in stems:
        breast_m = stem["ground"] + _BREAST_HEIGHT_M
        at = point + (breast_m - point[2]) * along / along[2]
        apart_m = float(np.hypot(at[0] - stem["x"], at[1] - stem["y"]))
        low_m, high_m = heights_m.min() - _BEYOND_M, heights_m.max() + _BEYOND_M
        if apart_m > _SAME_M or not low_m <= breast_m <= high_m:
            continue
        value, std = (
            float(np.interp(breast_m, heights_m[order], values[order]))
            for values in (tree.profile.diameter_m, tree.profile.diameter_std_m)
        )
        yield replace(tree, dbh_m=Estimate(value, std)), {"dbh_m": stem["dbh"]}
