"""Labels of the trees in a view, from the exact geometry and the rendered image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from basetree.arrays import Bool, Float
from perceptree.simulator.labelling.silhouette import CLOSEST_M, outline_points, silhouette_area_px
from perceptree.simulator.rendering.render import Drawing
from perceptree.simulator.rendering.view import View
from perceptree.simulator.scene.description import Tree
from perceptree.simulator.scene.stem import BREAST_HEIGHT_M
from perceptree.simulator.settings import LabelSettings
from perceptree.simulator.vectors import unit

VISIBLE, HIDDEN, OUTSIDE = 2, 1, 0


@dataclass(frozen=True)
class TreeLabel:
    """One labelled tree. Heights are above the ground on the uphill side of the stem.

    Attributes:
        mask: (H, W) bool, visible pixels of the lower stem.
        box_px: (4,) xyxy bounds of the mask, px.
        keypoints: (5, 3) x px, y px (corner-based) and COCO flag.
        distance_m: Distance from the camera to the stem's axis at the cut, m.
        position_camera_m: (3,) the axis at the cut in camera axes, m.
        position_world_m: (3,) the axis at the cut in the world, m.
        diameter_m: Diameter at the diameter keypoints (convex girth over pi), m.
        diameter_height_m: Height of the diameter keypoints, m.
        diameter_breast_m: Diameter at 1.3 m (convex girth over pi), m.
        cut_height_m: Height of the felling cut, m.
        inclination_deg: Inclination of the lower stem from the vertical.
        visible_fraction: Visible fraction of the stem's silhouette in the frame.
        species: Species.
        model: Name of the tree model.
        stem: Number of the tree in its scene, the same in every view.
    """

    mask: Bool
    box_px: Float
    keypoints: Float
    distance_m: float
    position_camera_m: Float
    position_world_m: Float
    diameter_m: float
    diameter_height_m: float
    diameter_breast_m: float
    cut_height_m: float
    inclination_deg: float
    visible_fraction: float
    species: str
    model: str
    stem: int


def label_view(
    view: View, drawing: Drawing, trees: list[Tree], settings: LabelSettings
) -> list[TreeLabel]:
    """Label every tree within reach whose lower stem is visible enough.

    Args:
        view: The camera.
        drawing: The rendered view.
        trees: The near trees of the scene, in the order of their numbers in the drawing.
        settings: Limits of distance and visibility.
    """
    pixels = np.bincount(drawing.object_id.ravel(), minlength=len(trees) + 1)
    least = max(1.0, settings.min_visible_area * drawing.object_id.size)
    labels = []
    for number, tree in enumerate(trees, start=1):
        distance_m = float(np.linalg.norm(tree.point(tree.cut_z_m) - view.origin))
        if pixels[number] < least or distance_m > settings.reach_m:
            continue
        fraction = min(1.0, pixels[number] / max(silhouette_area_px(view, tree), 1))
        if fraction >= settings.min_visible_fraction:
            mask = drawing.object_id == number
            labels.append(_label(view, tree, mask, distance_m, float(fraction), number))
    return labels


def _label(
    view: View,
    tree: Tree,
    mask: Bool,
    distance_m: float,
    fraction: float,
    number: int,
) -> TreeLabel:
    columns, rows = np.nonzero(mask.any(0))[0], np.nonzero(mask.any(1))[0]
    box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], float)
    lower_axis = tree.point(tree.top_z_m / 2) - tree.point(tree.cut_z_m)
    inclination = float(np.degrees(np.arccos(unit(lower_axis)[2])))
    cut, stem = tree.point(tree.cut_z_m), tree.stem
    return TreeLabel(
        mask,
        box,
        _keypoints(view, tree, mask),
        distance_m,
        view.to_camera(cut),
        cut,
        stem.girth_diameter_m(tree.diameter_z_m),
        tree.diameter_height_m,
        stem.girth_diameter_m(tree.uphill_m + BREAST_HEIGHT_M),
        tree.cut_height_m,
        inclination,
        fraction,
        stem.model.species,
        stem.model.name,
        number,
    )


def _keypoints(view: View, tree: Tree, mask: Bool) -> Float:
    axis_top = tree.point(tree.top_z_m / 2)
    axis_middle = tree.point((tree.cut_z_m + tree.top_z_m / 2) / 2)
    left, right = outline_points(view, tree, tree.diameter_z_m)
    points = np.stack([_front_point(view, tree, tree.cut_z_m), left, right, axis_middle, axis_top])
    keypoints = np.zeros((5, 3))
    in_front = view.to_camera(points)[:, 2] > CLOSEST_M
    keypoints[in_front, :2] = view.project(points[in_front])
    height, width = mask.shape
    near = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    for index, (x, y, _) in enumerate(keypoints):
        if in_front[index] and 0 <= x < width and 0 <= y < height:
            keypoints[index, 2] = VISIBLE if near[int(y), int(x)] else HIDDEN
        else:
            keypoints[index] = (0.0, 0.0, OUTSIDE)
    return keypoints


def _front_point(view: View, tree: Tree, height_m: float) -> Float:
    """(3,) point of the bark in the world that faces the camera at a height above the foot."""
    ring = tree.ring(height_m)
    towards = view.origin - tree.point(height_m)
    return np.asarray(ring[np.argmax((ring - ring.mean(0)) @ towards)])
