"""Trees beyond the reach of a model's labels, told by depth and camera.

The labels of a training end at some distance from the camera. A network sees only the depth along
the optical axis. At the edge of a wide picture the distance is larger, and how much depends on the
camera, which the network does not know. Where the camera is given, the distance is computed here.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Bool, Float
from calib import PinholeCamera, pixels_to_rays
from edgetree.detections import TreeDetections

DISTANCE_STD: Final = 0.015
"""Standard deviation of a stem's distance as it is found here, relative to the reach.

Source: with 0.01 to 0.02, average precision and false trees are the same on simulated frames
(presets `paper` and `field`, seed 924)."""
LEAST_READ: Final = 0.3
"""Smallest share of a stem's cells with a reading that tells its distance.

Source: with 0.2 to 0.5, the same; a stem without depth must not be taken for what is behind it."""
_STEM: Final = 0.5


def within_reach(
    trees: TreeDetections, depth_m: NDArray[np.floating], camera: PinholeCamera, reach_m: float
) -> TreeDetections:
    """Multiply each score by the chance that the tree stands within reach.

    Scores never rise. A tree without masks, or with too few readings, keeps its score.

    Args:
        trees: N trees, by descending score.
        depth_m: (H, W) metres along the optical axis of the same picture; 0, NaN and infinity mean
            no reading.
        camera: Camera of the picture, of its size.
        reach_m: Distance from the camera to the axis of a stem at its foot up to which trees
            count, m.

    Returns:
        The trees by descending score.
    """
    if not len(trees) or trees.masks is None:
        return trees
    chances = reach_chances(trees.boxes_px, trees.masks, depth_m, camera, reach_m)
    scored = replace(trees, scores=(trees.scores * chances).astype(np.float32))
    return scored.select(np.argsort(-scored.scores, kind="stable"))


def reach_chances(
    boxes_px: Float,
    masks: Float,
    depth_m: NDArray[np.floating],
    camera: PinholeCamera,
    reach_m: float,
) -> Float:
    """The chance of each tree that it stands within reach.

    Args:
        boxes_px: (N, 4) x0, y0, x1, y1 in continuous px.
        masks: (N, S, S) probabilities on a grid over each box.
        depth_m: (H, W) as for `within_reach`.
        camera: As for `within_reach`.
        reach_m: As for `within_reach`.

    Returns:
        (N,) 0 to 1; 1 for a tree with too few readings.
    """
    if not len(boxes_px):
        return np.ones(0)
    distance_m = stem_distances_m(boxes_px, masks, depth_m, camera)
    near = (reach_m - distance_m) / (DISTANCE_STD * reach_m)
    chances = [0.5 * math.erfc(-value / math.sqrt(2)) for value in near.tolist()]
    return np.where(np.isnan(distance_m), 1.0, chances)


def stem_distances_m(
    boxes_px: Float, masks: Float, depth_m: NDArray[np.floating], camera: PinholeCamera
) -> Float:
    """The distance from the camera to the axis of each stem at the lower end of its box.

    The depth is the median over the lower half of the mask, to which half of the stem's width is
    added.

    Args:
        boxes_px: (N, 4) x0, y0, x1, y1 in continuous px.
        masks: (N, S, S) probabilities on a grid over each box.
        depth_m: (H, W) as for `within_reach`.
        camera: As for `within_reach`.

    Returns:
        (N,) m; NaN where too few cells of the stem have a reading.
    """
    boxes = np.asarray(boxes_px, np.float64)
    stem = _lower_half(np.asarray(masks) >= _STEM)
    cells_px = (boxes[:, 2:] - boxes[:, :2]) / stem.shape[-1]
    readings_m = np.where(stem, _at_cells(depth_m, boxes[:, :2], cells_px, stem.shape[-1]), np.nan)
    sorted_m = np.sort(readings_m.reshape(len(boxes), -1), axis=1)  # NaN last
    read, cells = np.isfinite(sorted_m).sum(axis=1), stem.sum(axis=(1, 2))
    middle_m = sorted_m[np.arange(len(boxes)), np.maximum(read - 1, 0) // 2]
    foot_px = np.stack([boxes[:, ::2].mean(axis=1), boxes[:, 3]], axis=1)
    along = np.linalg.norm(pixels_to_rays(camera, foot_px), axis=1)
    width_px = cells / np.maximum(stem.any(axis=2).sum(axis=1), 1) * cells_px[:, 0]
    axis_m = middle_m * (along + 0.5 * width_px / camera.fx)
    return np.where(read >= np.maximum(LEAST_READ * cells, 1), axis_m, np.nan)


def _lower_half(stem: Bool) -> Bool:
    """The cells (N, S, S) of a mask in the lower half of its rows."""
    rows = np.asarray(stem.any(axis=2))
    first, after = rows.argmax(axis=1), rows.shape[1] - rows[:, ::-1].argmax(axis=1)
    lower = np.arange(rows.shape[1]) >= ((first + after) // 2)[:, None]
    return np.asarray(stem & lower[:, :, None])


def _at_cells(
    depth_m: NDArray[np.floating], corners_px: Float, cells_px: Float, size: int
) -> Float:
    """(N, S, S) depth at the middle of each cell; NaN without a reading, and off the picture."""
    middles = np.arange(size) + 0.5
    places = np.floor(corners_px[:, :, None] + cells_px[:, :, None] * middles).astype(np.intp)
    columns, rows = places[:, 0], places[:, 1]
    height, width = depth_m.shape
    inside = np.asarray((places >= 0) & (places < np.array([[width], [height]])))
    shown = inside[:, 1, :, None] & inside[:, 0, None, :]
    found = depth_m[
        rows.clip(0, height - 1)[:, :, None], columns.clip(0, width - 1)[:, None, :]
    ].astype(np.float64)
    return np.where(shown & np.isfinite(found) & (found > 0), found, np.nan)
