"""Detections of stems, and depth that shows each at a distance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from basetree.arrays import Float32
from calib import PinholeCamera
from edgetree import TreeDetections, TreeDetector, default_model
from edgetree.runtime import FakeSession

WIDTH, HEIGHT, FOCAL_PX = 640, 480, 400.0
CAMERA = PinholeCamera(WIDTH, HEIGHT, FOCAL_PX, FOCAL_PX, WIDTH / 2 - 0.5, HEIGHT / 2 - 0.5)
REACH_M = 10.0


def trees(*boxes: tuple[float, float, float, float]) -> TreeDetections:
    """Trees whose masks fill the middle half of their boxes' columns."""
    masks = np.zeros((len(boxes), 28, 28), np.float32)
    masks[:, :, 7:21] = 1.0
    scores = np.linspace(0.9, 0.8, len(boxes)).astype(np.float32)
    return TreeDetections(np.array(boxes, np.float32), scores, None, masks, WIDTH, HEIGHT)


def stems_m(found: TreeDetections, depths_m: list[float]) -> Float32:
    """(H, W) depth of a wall 20 m away, with a stem at a depth in the middle of each box."""
    depth_m = np.full((HEIGHT, WIDTH), 20.0, np.float32)
    for (left, top, right, bottom), z_m in zip(found.boxes_px.tolist(), depths_m, strict=True):
        quarter = (right - left) / 4
        columns = slice(round(left + quarter), round(right - quarter))
        depth_m[round(top) : round(bottom), columns] = z_m
    return depth_m


def faked(found: TreeDetections, reach_m: float | None = REACH_M) -> TreeDetector:
    """A depth model that finds these trees in every picture of 640x480 px."""
    manifest = replace(TreeDetector.load(default_model("depth")).manifest, reach_m=reach_m)
    scale = min(manifest.input.width / WIDTH, manifest.input.height / HEIGHT)
    boxes = found.boxes_px * np.float32(scale)
    return TreeDetector(FakeSession.with_trees(manifest, boxes, found.scores, masks=found.masks))


# Of the same depth, one in the middle of the picture and one at its edge.
PAIR = trees((310, 100, 330, 240), (600, 100, 620, 240))
PAIR_M = stems_m(PAIR, [9.0, 9.0])
