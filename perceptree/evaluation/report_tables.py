"""Tables of the evaluation report: average precision, keypoint errors, results by condition."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from basetree.page import parts

Figures = dict[str, Any]

FEW_TREES = 20
"""Groups of fewer trees say little."""

_PRECISIONS = {
    "ap": "AP",
    "ap50": "AP50",
    "ap75": "AP75",
    "ap_small": "small",
    "ap_medium": "medium",
    "ap_large": "large",
}
_GROUP_COLUMNS = {
    "frames": "images",
    "trees": "trees",
    "recall": "recall",
    "precision": "precision",
    "boxes_ap": "box AP",
    "masks_ap": "mask AP",
    "keypoints_ap": "keypoint AP",
    "felling_cut_median_px": "cut error (median), px",
    "diameter_mean_abs_px": "diameter error (mean), px",
    "diameter_bias_px": "diameter bias, px",
}
_SHARES = ("recall", "precision")
_DIRECTIONS = ("across", "along", "horizontal", "vertical")
_NONE = "–"


def precision_table(figures: Figures) -> str:
    """COCO's average precision of boxes, masks and keypoints."""
    rows = []
    for kind, found in figures["average_precision"].items():
        values = (None if found is None else found[name] for name in _PRECISIONS)
        rows.append([kind, *(_NONE if value is None else f"{value:.1f}" for value in values)])
    return parts.table(["", *_PRECISIONS.values()], rows)


def keypoint_table(figures: Figures) -> str:
    """The errors of each keypoint in px."""
    heads = ("keypoint", "trees", "median, px", "mean, px", "90th percentile, px")
    spreads = (parts.Cell(f"{name}: mean&nbsp;±&nbsp;σ") for name in _DIRECTIONS)
    rows = (
        [name.replace("_", " "), *_keypoint_cells(errors)]
        for name, errors in figures["keypoint_error_px"].items()
    )
    return parts.table([*heads, *spreads], rows)


def _keypoint_cells(errors: Figures) -> Iterator[str]:
    distance = errors["distance"]
    yield "0" if distance is None else f"{distance['count']:,}"
    for name in ("median", "mean", "p90_abs"):
        yield _NONE if distance is None else f"{distance[name]:.1f}"
    for way in _DIRECTIONS:
        spread = errors[way]
        none = distance is None or spread is None
        yield _NONE if none else f"{spread['mean']:+.1f} ± {spread['sigma']:.1f}"


def group_table(axis: Figures) -> str:
    """The results of each group of trees, as a card."""
    groups: Sequence[Figures] = axis["groups"]
    columns = [
        name
        for name in _GROUP_COLUMNS
        if any(group.get(name) is not None for group in groups)
        and (axis["of_frames"] or name != "frames")
    ]
    rows = (
        parts.row(
            [group["name"], *(_cell(name, group.get(name)) for name in columns)],
            "few" if group["trees"] < FEW_TREES else "",
        )
        for group in groups
    )
    return parts.card(
        axis["title"], parts.table(["", *(_GROUP_COLUMNS[name] for name in columns)], rows)
    )


def certain_table(certain: Figures) -> str:
    """Recall by distance with far trees ignored and with all of them counted, as a card."""
    graded = {group["name"]: group for group in certain["graded"]["by_distance"]}
    rows = (
        [group["name"], *_recall_cells(graded.get(group["name"])), *_recall_cells(group)]
        for group in certain["plain"]["by_distance"]
    )
    limit = f"{certain['certain_m']:g} m"
    totals = " ".join(
        f"{title}: {rule['found']:,} of {rule['found'] + rule['missed']:,} trees found,"
        f" {rule['invented']:,} false positives."
        for title, rule in (
            (f"Beyond {limit} ignored", certain["graded"]),
            ("All counted", certain["plain"]),
        )
    )
    heads = ["", f"trees, beyond {limit} ignored", "recall", "trees, all counted", "recall"]
    return parts.card("Recall by distance under both rules", parts.table(heads, rows), totals)


def _recall_cells(group: Figures | None) -> Iterator[parts.Cell | str]:
    for name in ("trees", "recall"):
        yield _cell(name, None if group is None else group[name])


def _cell(name: str, value: float | None) -> parts.Cell | str:
    if value is None:
        return _NONE
    if name in _SHARES:
        return parts.share_cell(f"{100 * value:.0f} %", 100 * value)
    if name.endswith("_ap"):
        return parts.share_cell(f"{value:.1f}", value)
    if name in ("frames", "trees"):
        return f"{value:,}"
    return f"{value:+.1f}" if name.endswith("bias_px") else f"{value:.1f}"
