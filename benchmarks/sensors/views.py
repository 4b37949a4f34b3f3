"""One depth picture with stems of known size, measured with one outline or another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from basetree.arrays import Bool, Float, Float32
from calib import PinholeCamera
from edgetree import TreeDetections, TreeDetector
from edgetree.catalogue import find_model
from edgetree.measure import TreeMeasurement, measure_trees

NETWORKS = ("edge-n-depth", "edge-s-depth")
OUTLINES = "outlines"
"""Name of the outlines that a view has by itself."""

Readings = Iterator[tuple[TreeMeasurement, dict[str, Any]]]


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """A depth picture.

    Attributes:
        depth_m: (H, W) depth.
        camera: Its camera.
        up: (3,) the vertical in the camera's frame; None if it is not known.
        places_px: A place on each of the stems.
        truths: Their true values by name.
        outlines: (H, W) masks of these stems, if they are known.
    """

    depth_m: Float32
    camera: PinholeCamera
    up: Float | None
    places_px: list[Float]
    truths: list[dict[str, Any]]
    outlines: list[Bool] | None = None


@cache
def detector(name: str) -> TreeDetector:
    """A packaged model."""
    return TreeDetector.load(find_model(name), threads=1, score_threshold=0.5)


def readings(view: View, source: str) -> Readings:
    """Measurements of the stems of a view with their true values; those not found have failed.

    Args:
        view: The depth picture.
        source: `OUTLINES`, or the name of a model.
    """
    if source == OUTLINES:
        assert view.outlines is not None
        found = measure_trees(
            _boxes(view), view.depth_m, view.camera, masks=view.outlines, up_camera=view.up
        )
        yield from zip(found, view.truths, strict=True)
        return
    trees = detector(source).detect(view.depth_m)
    found = measure_trees(trees, view.depth_m, view.camera, up_camera=view.up)
    for place_px, truth in zip(view.places_px, view.truths, strict=True):
        index = _at(trees, place_px)
        yield TreeMeasurement.failed("not found") if index is None else found[index], truth


def _at(trees: TreeDetections, place_px: Float) -> int | None:
    """The detection at a place: of those around it, the one whose middle is nearest across."""
    low, high = trees.boxes_px[:, :2], trees.boxes_px[:, 2:]
    around = np.flatnonzero(((low <= place_px) & (place_px <= high)).all(1))
    if not len(around):
        return None
    aside = np.abs((low + high)[around, 0] / 2 - place_px[0])
    return int(around[aside.argmin()])


def _boxes(view: View) -> TreeDetections:
    """The outlines as detections without masks or keypoints of their own."""
    boxes = []
    for mask in view.outlines or ():
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        boxes.append([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
    count, camera = len(boxes), view.camera
    return TreeDetections(
        np.array(boxes, np.float32).reshape(-1, 4),
        np.ones(count, np.float32),
        None,
        None,
        camera.width,
        camera.height,
    )
