"""Results of an evaluation as a few lines for a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from basetree.counts import counted

Figures = dict[str, Any]

_PRECISIONS = ("ap", "ap50", "ap75", "ap_small", "ap_medium", "ap_large")
_HEADS = ("AP", "AP50", "AP75", "small", "medium", "large")
_FEW_TREES = 20
_MAX_GROUPS = 3


def title_of(figures: Figures) -> str:
    """Return a one-line description of the model."""
    model = figures["model"]
    width, height = model["input_px"]
    return f"{model['name']} ({model['modality']}, {model['precision']}, {width}x{height})"


def summary_lines(figures: Figures) -> Iterator[str]:
    """Yield the most important results, one line each."""
    data, shown = figures["data"], figures["at_score"]
    yield f"{title_of(figures)} on {data['folder']}, {data['split']}"
    yield f"{counted(data['frames'], 'frame')}, {counted(data['trees'], 'tree')}"
    for line in data["notes"]:
        yield f"data: {line}"
    yield f"{'':9}" + "".join(f"{head:>8}" for head in _HEADS)
    for kind, found in figures["average_precision"].items():
        cells = [None if found is None else found[name] for name in _PRECISIONS]
        yield f"{kind:9}" + "".join(
            f"{'–' if cell is None else f'{cell:.1f}':>8}" for cell in cells
        )
    reported = shown["found"] + shown["invented"]
    yield (
        f"at score {shown['score']}: {shown['found']} of {data['trees']} trees found"
        f" ({shown['recall']:.0%}), {shown['invented']} of {reported} detections are false"
        " positives"
    )
    if figures["certain"] is not None:
        yield from _certain_lines(figures["certain"])
    if figures["reliability"]["detections"]:
        yield (
            "scores: they differ from the share of labelled trees by"
            f" {figures['reliability']['expected_error']:.3f} on average"
        )
    yield from _error_lines(figures)
    yield from _weakest(figures)
    for line in figures["left_out"]:
        yield f"left out: {line}"


def _certain_lines(certain: Figures) -> Iterator[str]:
    """Yield recall by distance under both rules."""
    plain, limit = certain["plain"], f"{certain['certain_m']:g} m"
    reported = plain["found"] + plain["invented"]
    yield (
        f"with trees beyond {limit} counted: {plain['found']} of"
        f" {plain['found'] + plain['missed']} trees found ({plain['recall']:.0%}),"
        f" {plain['invented']} of {reported} false positives"
    )
    graded = {group["name"]: group for group in certain["graded"]["by_distance"]}
    for group in plain["by_distance"]:
        near = graded.get(group["name"])
        yield (
            f"  {group['name']:12} {_recall_of(group)}; to {limit}"
            f" {'–' if near is None else _recall_of(near)}"
        )


def _recall_of(group: Figures) -> str:
    return f"{group['found']} of {group['trees']} found ({group['recall']:.0%})"


def _error_lines(figures: Figures) -> Iterator[str]:
    keypoints, width = figures["keypoint_error_px"], figures["diameter_error_px"]
    for name, found in (keypoints or {}).items():
        if found["distance"] is None:
            yield f"{name.replace('_', ' '):15} {'–':>5} not labelled on any tree that was found"
            continue
        line = f"{name.replace('_', ' '):15} {found['distance']['median']:5.1f} px error (median)"
        if found["across"] is not None:
            line += (
                f"; across the trunk {found['across']['median_abs']:.1f},"
                f" along it {found['along']['median_abs']:.1f}"
            )
        yield line
    if width is not None:
        yield (
            f"{'diameter':15} {width['mean_abs']:5.1f} px error (mean), median"
            f" {width['median_abs']:.1f}, {abs(width['mean']):.1f} too"
            f" {'wide' if width['mean'] >= 0 else 'narrow'} on average"
        )


def _weakest(figures: Figures) -> Iterator[str]:
    """Yield the groups with the lowest recall, one per condition, without very small groups."""
    worst: list[tuple[float, str]] = []
    for axis in figures["by"].values():
        groups = [group for group in axis["groups"] if group["trees"] >= _FEW_TREES]
        if len(groups) > 1:
            least = min(groups, key=lambda group: group["recall"])
            worst.append((least["recall"], f"{axis['title'].lower()} {least['name']}"))
    if worst:
        named = (f"{name} ({recall:.0%})" for recall, name in sorted(worst)[:_MAX_GROUPS])
        yield f"lowest recall: {'; '.join(named)}"
