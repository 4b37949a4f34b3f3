"""The unoccluded silhouette of a stem in a view: outline points at a height, and area."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float
from perceptree.simulator.geometry.stems import STEM_SIDES, lower_levels_m
from perceptree.simulator.rendering.view import View
from perceptree.simulator.scene.description import Tree
from perceptree.simulator.vectors import unit

CLOSEST_M = 0.1  # points nearer to the camera plane are not projected
_BELOW_M = 0.2  # depth below the foot at which the silhouette's rings start
_COVER_RINGS = 26
_COVER_SIDES = 32


def outline_points(view: View, tree: Tree, height_m: float) -> tuple[Float, Float]:
    """Find the points of the bark on the left and right outline of the stem at a height.

    A straight line in the image across the axis is a plane through the camera. The outermost
    points of the bark in that plane are on the outline, also where the stem tapers or is
    irregular. The plane is chosen to contain the chord at which rays touch a round stem, which is
    r^2 / d in front of the axis. On a round stem the points are thus exactly on the section.

    Args:
        view: The camera.
        tree: The tree.
        height_m: Height of the section above the foot, m.

    Returns:
        (3,) left and (3,) right point in the world, m.
    """
    axis = tree.stem.direction(height_m)
    towards = tree.point(height_m) - view.origin
    level = towards - (towards @ axis) * axis
    distance_m = float(np.linalg.norm(level))
    forward, radius_m = level / distance_m, 0.5 * tree.stem.girth_diameter_m(height_m)
    side = np.cross(forward, axis)
    chord = towards - forward * radius_m**2 / distance_m
    cut = _plane_section(tree, view.origin + chord, unit(np.cross(side, chord)))
    if not len(cut):  # the camera is nearer to the axis than the bark: no ray touches the section
        cut = tree.ring(height_m)
    bearing = np.arctan2((cut - view.origin) @ side, (cut - view.origin) @ unit(chord))
    return cut[np.argmin(bearing)], cut[np.argmax(bearing)]


def _plane_section(tree: Tree, point_m: Float, normal: Float) -> Float:
    """(n, 3) intersections of a plane with the edges of the bark's triangles above ground, m."""
    levels = lower_levels_m(tree.stem, tree.label_heights_m)
    rings = tree.position_m + tree.stem.rings(levels, STEM_SIDES)
    edges = (rings[:-1], rings[1:]), (rings[:, :-1], rings[:, 1:]), (rings[:-1, :-1], rings[1:, 1:])
    starts, ends = (np.concatenate([edge[k].reshape(-1, 3) for edge in edges]) for k in (0, 1))
    low, high = (starts - point_m) @ normal, (ends - point_m) @ normal
    crossed = (low * high <= 0) & (low != high)
    share = (low[crossed] / (low[crossed] - high[crossed]))[:, None]
    cut = starts[crossed] * (1 - share) + ends[crossed] * share
    return np.asarray(cut[cut[:, 2] >= tree.position_m[2]])


def silhouette_area_px(view: View, tree: Tree) -> int:
    """Count the pixels that the lower stem and its fork would cover without any occlusion."""
    camera = view.intrinsics
    starts = np.zeros((camera.height, camera.width + 1), np.int8)
    for rings in _lower_rings(tree):
        ahead = view.to_camera(rings)[..., 2].min(1) > CLOSEST_M
        for low in np.nonzero(ahead[:-1] & ahead[1:])[0]:
            corners = view.project(rings[low : low + 2].reshape(-1, 3))
            hull = cv2.convexHull(corners.astype(np.float32))[:, 0].astype(np.float64)
            _count_spans(hull, starts)
    return int((np.cumsum(starts, axis=1, dtype=np.int8) > 0).sum())


def _lower_rings(tree: Tree) -> list[Float]:
    """(heights, sides, 3) rings of each leader of the labelled stem, from the ground upwards, m."""
    stem = tree.stem
    top_m = min(tree.top_z_m, stem.height_m)
    parts = [stem.rings(np.linspace(-_BELOW_M, top_m, _COVER_RINGS), _COVER_SIDES)]
    if stem.fork is not None and stem.fork.height_m < top_m:
        levels = np.linspace(stem.fork.height_m, min(top_m, stem.fork.top_m), _COVER_RINGS)
        parts.append(stem.fork_rings(levels, _COVER_SIDES))
    return [tree.position_m + _above_ground(part[:, :-1]) for part in parts]


def _above_ground(rings: Float) -> Float:
    """Move all points of the rings below z = 0 along the bark to z = 0."""
    below = rings[..., 2] < 0
    side = np.arange(rings.shape[1])
    last = np.maximum(below.sum(0) - 1, 0)
    low, high = rings[last, side], rings[last + 1, side]
    share = (low[:, 2] / np.minimum(low[:, 2] - high[:, 2], -1e-9))[:, None]
    return np.where(below[..., None], low * (1 - share) + high * share, rings)


def _count_spans(hull: Float, starts: NDArray[np.int8]) -> None:
    """Add +1 at the start and -1 at the end of each row's pixels in a convex outline (n, 2)."""
    height, width = starts.shape[0], starts.shape[1] - 1
    first = max(0, int(np.ceil(hull[:, 1].min() - 0.5)))
    last = min(height - 1, int(np.floor(hull[:, 1].max() - 0.5)))
    if first > last:
        return
    rows = np.arange(first, last + 1)
    x0, y0 = hull.T[..., None]
    x1, y1 = np.roll(hull, -1, axis=0).T[..., None]
    crossed = (y0 <= rows + 0.5) != (y1 <= rows + 0.5)
    x = x0 + (rows + 0.5 - y0) / np.where(crossed, y1 - y0, 1.0) * (x1 - x0)
    left = np.where(crossed, x, np.inf).min(0)
    right = np.where(crossed, x, -np.inf).max(0)
    begin = np.clip(np.ceil(left - 0.5), 0, width).astype(int)
    end = np.clip(np.floor(right - 0.5) + 1, 0, width).astype(int)
    some = begin < end
    np.add.at(starts, (rows[some], begin[some]), 1)
    np.add.at(starts, (rows[some], end[some]), -1)
