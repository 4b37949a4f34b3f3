"""The few words that stand beside a tree in a picture."""

from __future__ import annotations

from edgetree.detections import TreeDetections
from edgetree.measure import Estimate, TreeMeasurement

__all__ = ["tree_labels"]

_LONGEST = 36


def tree_labels(
    trees: TreeDetections, measurements: list[TreeMeasurement] | None = None
) -> list[list[str]]:
    """Lines for each tree: diameter, cut height and distance where measured, else its score."""
    if measurements is None:
        return [[f"tree {score:.0%}"] for score in trees.scores]
    return [_measured(measurement) for measurement in measurements]


def _measured(tree: TreeMeasurement) -> list[str]:
    diameter = tree.diameter_m
    if isinstance(diameter, Estimate):
        first = f"Ø {diameter.value:.3f} ±{diameter.std:.3f} m"
    else:
        first = f"Ø ? {diameter.reason}"[:_LONGEST]
    second = []
    if isinstance(tree.cut_height_m, Estimate):
        second.append(f"cut {tree.cut_height_m.value:.2f} m")
    if isinstance(tree.distance_m, Estimate):
        second.append(f"dist {tree.distance_m.value:.1f} m")
    return [first, "  ".join(second)]
