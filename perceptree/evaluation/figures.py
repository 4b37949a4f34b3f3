"""All results of an evaluation as one JSON-ready dictionary."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.data import FrameRecord
from perceptree.data.grading import ungraded
from perceptree.evaluation.coco_matching import Kind
from perceptree.evaluation.errors_px import (
    DIRECTIONS,
    PixelErrors,
    Spread,
    density,
    histogram,
    round_reach,
)
from perceptree.evaluation.groups import AXES, DISTANCE, Axis, Group, groups_of
from perceptree.evaluation.matching import DISPLAY_SCORE, MATCH_IOU, Matches, match_trees
from perceptree.evaluation.metrics import Measured
from perceptree.evaluation.precision import KINDS
from perceptree.evaluation.reliability import reliability, scored_detections
from perceptree.keypoints import KEYPOINT_NAMES

SCHEMA = "perceptree.evaluation/1"
KIND_NAMES: dict[Kind, str] = {"bbox": "boxes", "segm": "masks", "keypoints": "keypoints"}

Figures = dict[str, Any]


@dataclass(frozen=True)
class About:
    """What was evaluated.

    Attributes:
        model: JSON-ready description of the model; the title uses `name`, `modality`,
            `precision` and `input_px`.
        data: Folder of the dataset.
        split: "train", "val" or "test".
        notes: Messages about reading the data.
        certain_m: Distance beyond which the labelled trees are ignored, m; None for no limit.
    """

    model: Mapping[str, Any]
    data: str
    split: str
    notes: tuple[str, ...] = ()
    certain_m: float | None = None


def figures_of(measured: Measured, about: About) -> Figures:
    """Return all results except images.

    AP is in percent, shares are 0 to 1, other units are in the names.
    """
    matches, errors = measured.matches, measured.errors
    by = {axis.name: _axis_figures(measured, axis) for axis in AXES}
    return {
        "schema": SCHEMA,
        "model": dict(about.model),
        "data": _data_figures(measured, about),
        "average_precision": {
            KIND_NAMES[kind]: None if found is None else _rounded(dataclasses.asdict(found))
            for kind in KINDS
            for found in [measured.scorer.precision(kind)]
        },
        "precision_at_recall": {
            KIND_NAMES[kind]: None if curve is None else [round(value, 4) for value in curve]
            for kind in KINDS
            for curve in [measured.scorer.curve(kind)]
        },
        "at_score": {
            "score": DISPLAY_SCORE,
            "iou": MATCH_IOU,
            **_counts(matches),
        },
        "certain": _certain_figures(measured, about.certain_m),
        "boxes_by_score": measured.scorer.by_score("bbox"),
        "reliability": reliability(scored_detections(measured.store.frames, measured.predictions)),
        "keypoint_error_px": None if errors is None else _keypoint_figures(errors),
        "felling_cut_density": None
        if errors is None
        else density(errors.of(0, "horizontal"), errors.of(0, "vertical")),
        "diameter_error_px": None if errors is None else _spread(errors.width),
        "by": {name: axis for name, axis in by.items() if axis["groups"]},
        "left_out": _left_out(measured, [a.title for a in AXES if not by[a.name]["groups"]]),
    }


def _data_figures(measured: Measured, about: About) -> Figures:
    frames = measured.store.frames
    sizes = Counter(f"{frame.width}x{frame.height}" for frame in frames)
    return {
        "folder": about.data,
        "split": about.split,
        "frames": len(frames),
        "trees": measured.store.trees,
        "crowds": sum(tree.crowd for frame in frames for tree in frame.trees),
        "ignored": measured.scorer.trees - measured.store.trees,
        "picture_px": dict(sizes.most_common()),
        "notes": list(about.notes),
    }


def _counts(matches: Matches) -> Figures:
    return {
        "found": len(matches.found),
        "missed": len(matches.missed),
        "invented": len(matches.invented),
        "recall": round(matches.recall, 4),
        "precision": None if matches.precision is None else round(matches.precision, 4),
    }


def _certain_figures(measured: Measured, certain_m: float | None) -> Figures | None:
    """Return the counts with trees beyond `certain_m` ignored, and with all of them counted."""
    if certain_m is None:
        return None
    frames = ungraded(measured.store.frames)
    return {
        "certain_m": certain_m,
        "graded": _rule_figures(measured.store.frames, measured.matches),
        "plain": _rule_figures(frames, match_trees(frames, measured.predictions)),
    }


def _rule_figures(frames: Sequence[FrameRecord], matches: Matches) -> Figures:
    groups = {
        group.name: (int(_is_inside(frames, matches, group).sum()), len(group.trees))
        for group in groups_of(frames, DISTANCE)
    }
    by_distance = [
        {"name": name, "trees": trees, "found": found, "recall": round(found / trees, 4)}
        for name, (found, trees) in groups.items()
    ]
    return {**_counts(matches), "by_distance": by_distance}


def _is_inside(frames: Sequence[FrameRecord], matches: Matches, group: Group) -> NDArray[np.bool_]:
    """Whether each found tree is of the group."""
    first = np.cumsum([0, *(len(frame.trees) for frame in frames)])
    return np.array([first[p.frame] + p.tree in group.trees for p in matches.found], bool)


def _keypoint_figures(errors: PixelErrors) -> Figures:
    """Return the error statistics of each keypoint; its histograms share one range."""
    figures: Figures = {}
    for index, name in enumerate(KEYPOINT_NAMES):
        by_direction = {direction: errors.of(index, direction) for direction in DIRECTIONS}
        reach = round_reach(by_direction["distance"])
        figures[name] = {
            direction: _spread(values, reach) for direction, values in by_direction.items()
        }
    return figures


def _spread(values: Any, reach: float | None = None) -> Figures | None:
    spread = Spread.of(values)
    if spread is None:
        return None
    return {**spread.to_dict(), "histogram": histogram(values, reach or round_reach(values))}


def _axis_figures(measured: Measured, axis: Axis) -> Figures:
    groups = groups_of(measured.store.frames, axis)
    return {
        "title": axis.title,
        "of_frames": axis.of_frames,
        "groups": [_group_figures(measured, axis, group) for group in groups],
    }


def _group_figures(measured: Measured, axis: Axis, group: Group) -> Figures:
    """Return recall, precision, AP and errors of a group of trees."""
    matches, errors = measured.matches, measured.errors
    inside = _is_inside(measured.store.frames, matches, group)
    found = int(inside.sum())
    figures: Figures = {
        "name": group.name,
        "frames": len(group.frames),
        "trees": len(group.trees),
        "recall": round(found / len(group.trees), 4),
    }
    if axis.of_frames:
        invented = sum(frame in group.frames for frame, _ in matches.invented)
        reported = found + invented
        figures["precision"] = round(found / reported, 4) if reported else None
    for kind in KINDS:
        ap = measured.scorer.part(kind, group.trees, group.frames)
        figures[f"{KIND_NAMES[kind]}_ap"] = None if ap is None else round(ap, 3)
    if errors is not None:
        cut = Spread.of(errors.of(0, "distance")[inside])
        width = Spread.of(errors.width[inside])
        figures["felling_cut_median_px"] = None if cut is None else round(cut.median, 3)
        figures["diameter_mean_abs_px"] = None if width is None else round(width.mean_abs, 3)
        figures["diameter_bias_px"] = None if width is None else round(width.mean, 3)
    return figures


def _left_out(measured: Measured, axes: list[str]) -> list[str]:
    """Return what is missing from the results, and why."""
    reasons = []
    for kind, labelled in (
        ("masks", any(tree.segmentation for f in measured.store.frames for tree in f.trees)),
        (
            "keypoints",
            any((t.keypoints[:, 2] > 0).any() for f in measured.store.frames for t in f.trees),
        ),
    ):
        if any(getattr(prediction, kind) is None for prediction in measured.predictions):
            reasons.append(f"{kind}: the model does not predict them")
        elif not labelled:
            reasons.append(f"{kind}: no tree in the data is labelled with them")
        elif kind == "keypoints" and measured.errors is None:
            reasons.append(
                "errors in px: no tree with keypoints was found with a score of at least"
                f" {DISPLAY_SCORE}"
            )
    if axes:
        names = ", ".join(axis.lower() for axis in axes)
        reasons.append(f"results by {names}: the data has no such field")
    return reasons


def _rounded(values: Mapping[str, float | None]) -> dict[str, float | None]:
    return {name: None if value is None else round(value, 3) for name, value in values.items()}
