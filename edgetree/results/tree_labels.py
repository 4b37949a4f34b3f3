"""Texts for pictures: the label of each tree, and the mark at its felling cut."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera, project_points
from edgetree.detections import TreeDetections
from edgetree.drawing.trees import WARNING_SIGN, CutMark
from edgetree.measure import Estimate, PointEstimate, StemProfile, TreeMeasurement
from edgetree.results.units import AMOUNTS


def tree_labels(
    trees: TreeDetections, measurements: list[TreeMeasurement] | None = None
) -> list[list[str]]:
    """The label of each tree, as lines of text.

    With measurements: the values. The first line ends with `WARNING_SIGN` if there are warnings.
    There are no lines if nothing was measured; the tables give the reasons. Without measurements:
    the score.
    """
    if measurements is None:
        return [[f"tree {score:.0%}"] for score in trees.scores]
    return [_measured(measurement) for measurement in measurements]


def numbered(labels: Sequence[Sequence[str]], numbers: Sequence[object]) -> list[list[str]]:
    """The labels, each with the tree's number in front; the number alone for an empty label."""
    return [
        [f"{number}  {lines[0]}", *lines[1:]] if lines else [f"{number}"]
        for number, lines in zip(numbers, labels, strict=True)
    ]


def cut_marks(
    measurements: Sequence[TreeMeasurement], camera: PinholeCamera
) -> list[CutMark | None]:
    """The felling cut of each tree in pixels, with its height as text; None if not measured."""
    return [_cut_mark(measurement, camera) for measurement in measurements]


def profile_marks(
    measurements: Sequence[TreeMeasurement], camera: PinholeCamera
) -> list[NDArray[np.floating[Any]] | None]:
    """(N, 2, 2) left and right ends of the diameters along each tree in pixels, or None."""
    return [
        project_points(camera, tree.profile.edges_m)
        if isinstance(tree.profile, StemProfile)
        else None
        for tree in measurements
    ]


def _cut_mark(tree: TreeMeasurement, camera: PinholeCamera) -> CutMark | None:
    if not isinstance(tree.cut_point_m, PointEstimate):
        return None
    x, y = project_points(camera, tree.cut_point_m.xyz_m)
    return CutMark((float(x), float(y)), _short(tree, "cut_height_m"))


def _measured(tree: TreeMeasurement) -> list[str]:
    diameters = (("Ø", "diameter_m"), ("DBH", "dbh_m"))
    lines = [f"{word} {text}" for word, name in diameters if (text := _with_std(tree, name))]
    places = (("cut", "cut_height_m"), ("dist", "distance_m"))
    if not tree.distance_m:
        places = (("cut", "cut_height_m"), ("axis", "axis_distance_m"))
    known = [f"{word} {text}" for word, name in places if (text := _short(tree, name))]
    if known:
        lines.append("  ".join(known))
    if lines and tree.evidence.warnings:
        lines[0] = f"{lines[0]}  {WARNING_SIGN}"
    return lines


def _with_std(tree: TreeMeasurement, quantity: str) -> str:
    """The value with its standard deviation; empty if it was not measured."""
    result = getattr(tree, quantity)
    return AMOUNTS[quantity].with_std(result, " ±") if isinstance(result, Estimate) else ""


def _short(tree: TreeMeasurement, quantity: str) -> str:
    """The value with its unit; empty if it was not measured."""
    result = getattr(tree, quantity)
    amount = AMOUNTS[quantity]
    return f"{amount.value(result)} {amount.unit}" if isinstance(result, Estimate) else ""
