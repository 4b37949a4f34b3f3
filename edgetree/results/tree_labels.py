"""Texts for pictures: the label of each tree, and the mark at its felling cut."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap

from calib import PinholeCamera, project_points
from edgetree.detections import TreeDetections
from edgetree.drawing.trees import WARNING_SIGN, CutMark
from edgetree.measure import Estimate, PointEstimate, TreeMeasurement
from edgetree.results.units import AMOUNTS

__all__ = ["cut_marks", "numbered", "tree_labels"]

_LINE_LENGTH = 34
_MAX_LINES = 2


def tree_labels(
    trees: TreeDetections, measurements: list[TreeMeasurement] | None = None
) -> list[list[str]]:
    """The label of each tree, as lines of text.

    With measurements: the values, or the reason for a missing one, and the first warning. Without:
    the score.
    """
    if measurements is None:
        return [[f"tree {score:.0%}"] for score in trees.scores]
    return [_measured(measurement) for measurement in measurements]


def numbered(labels: Sequence[Sequence[str]], numbers: Sequence[object]) -> list[list[str]]:
    """The labels, each with the tree's number in front."""
    return [
        [f"{number}  {first}", *rest]
        for number, (first, *rest) in zip(numbers, labels, strict=True)
    ]


def cut_marks(
    measurements: Sequence[TreeMeasurement], camera: PinholeCamera
) -> list[CutMark | None]:
    """The felling cut of each tree in pixels, with its height as text; None if not measured."""
    return [_cut_mark(measurement, camera) for measurement in measurements]


def _cut_mark(tree: TreeMeasurement, camera: PinholeCamera) -> CutMark | None:
    if not isinstance(tree.cut_point_m, PointEstimate):
        return None
    x, y = project_points(camera, tree.cut_point_m.xyz_m)
    return CutMark((float(x), float(y)), _short(tree, "cut_height_m"))


def _measured(tree: TreeMeasurement) -> list[str]:
    if isinstance(tree.diameter_m, Estimate):
        lines = [f"Ø {AMOUNTS['diameter_m'].with_std(tree.diameter_m, ' ±')}"]
    else:
        lines = _wrapped(f"Ø ? {tree.diameter_m.reason}")
    if isinstance(tree.dbh_m, Estimate):
        lines.append(f"DBH {AMOUNTS['dbh_m'].with_std(tree.dbh_m, ' ±')}")
    places = (("cut", "cut_height_m"), ("dist", "distance_m"))
    known = [f"{word} {text}" for word, name in places if (text := _short(tree, name))]
    if known:
        lines.append("  ".join(known))
    if isinstance(tree.diameter_m, Estimate) and not isinstance(tree.cut_height_m, Estimate):
        lines += _wrapped(f"cut ? {tree.cut_height_m.reason}")
    for text in tree.evidence.warnings[:1]:
        lines += _wrapped(f"{WARNING_SIGN} {text}")
    return lines


def _short(tree: TreeMeasurement, quantity: str) -> str:
    """The value with its unit; empty if it was not measured."""
    result = getattr(tree, quantity)
    amount = AMOUNTS[quantity]
    return f"{amount.value(result)} {amount.unit}" if isinstance(result, Estimate) else ""


def _wrapped(text: str) -> list[str]:
    return wrap(text, _LINE_LENGTH, max_lines=_MAX_LINES, placeholder=" ...")
