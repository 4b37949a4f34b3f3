"""All figures of an evaluation as one JSON-ready dictionary."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from perceptree.evaluation.coco_matching import Kind
from perceptree.evaluation.errors_px import (
    DIRECTIONS,
    PixelErrors,
    Spread,
    density,
    histogram,
    round_reach,
)
from perceptree.evaluation.groups import AXES, Axis, Group, groups_of
from perceptree.evaluation.matching import DISPLAY_SCORE, MATCH_IOU
from perceptree.evaluation.metrics import Measured
from perceptree.evaluation.precision import KINDS
from perceptree.keypoints import KEYPOINT_NAMES

SCHEMA = "perceptree.evaluation/1"
KIND_NAMES: dict[Kind, str] = {"bbox": "boxes", "segm": "masks", "keypoints": "keypoints"}

Figures = dict[str, Any]


@dataclass(frozen=True)
class About:
    """What was measured on what: ``model`` says all that is known of it, JSON-ready.

    Of ``model``, ``name``, ``modality``, ``precision`` and ``input_px`` make the title. ``notes``
    say what was mapped or left out in reading the data.
    """

    model: Mapping[str, Any]
    data: str
    split: str
    notes: tuple[str, ...] = ()


def figures_of(measured: Measured, about: About) -> Figures:
    """Everything but pictures. AP is in percent, shares lie in 0 to 1, units are in the names."""
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
            "found": len(matches.found),
            "missed": len(matches.missed),
            "invented": len(matches.invented),
            "recall": round(matches.recall, 4),
            "precision": None if matches.precision is None else round(matches.precision, 4),
        },
        "boxes_by_score": measured.scorer.by_score("bbox"),
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
        "crowds": measured.scorer.trees - measured.store.trees,
        "picture_px": dict(sizes.most_common()),
        "notes": list(about.notes),
    }


def _keypoint_figures(errors: PixelErrors) -> Figures:
    """Per keypoint; the histograms of its two directions, of either kind, have one range."""
    figures: Figures = {}
    for place, name in enumerate(KEYPOINT_NAMES):
        ways = {direction: errors.of(place, direction) for direction in DIRECTIONS}
        reach = round_reach(ways["distance"])
        figures[name] = {way: _spread(values, reach) for way, values in ways.items()}
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
    """What was found and how well, of the trees of a group."""
    first = np.cumsum([0, *(len(frame.trees) for frame in measured.store.frames)])
    matches, errors = measured.matches, measured.errors
    inside = np.array([first[p.frame] + p.tree in group.trees for p in matches.found], bool)
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
    """What is not in the figures, and why."""
    said = []
    for kind, labelled in (
        ("masks", any(tree.segmentation for f in measured.store.frames for tree in f.trees)),
        (
            "keypoints",
            any((t.keypoints[:, 2] > 0).any() for f in measured.store.frames for t in f.trees),
        ),
    ):
        if any(getattr(prediction, kind) is None for prediction in measured.predictions):
            said.append(f"{kind}: the model gives none")
        elif not labelled:
            said.append(f"{kind}: no tree of the data has any")
        elif kind == "keypoints" and measured.errors is None:
            said.append(
                f"errors in px: no tree with keypoints was found at a score of {DISPLAY_SCORE}"
            )
    if axes:
        names = ", ".join(axis.lower() for axis in axes)
        said.append(f"figures by {names}: the data does not say")
    return said


def _rounded(values: Mapping[str, float | None]) -> dict[str, float | None]:
    return {name: None if value is None else round(value, 3) for name, value in values.items()}
