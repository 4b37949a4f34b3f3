"""An evaluation in words, for readers who know trees rather than networks."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import Any

from perceptree.evaluation.report_tables import FEW_TREES

Figures = dict[str, Any]

_AXES_IN_SUMMARY = 3


def paragraphs(figures: Figures) -> list[str]:
    """Return a summary in words as HTML paragraphs."""
    data, shown = figures["data"], figures["at_score"]
    reported = shown["found"] + shown["invented"]
    found = (
        f"The images contain {data['trees']:,} labelled trees. The detector finds"
        f" {100 * shown['recall']:.0f} of 100 of them."
    )
    if shown["precision"] is not None:
        found += (
            f" Of 100 detections, {100 * shown['precision']:.0f} are labelled trees"
            f" ({reported:,} detections in total)."
        )
    texts = [found, " ".join(_keypoint_sentences(figures)), " ".join(_group_sentences(figures))]
    return [text for text in texts if text]


def _keypoint_sentences(figures: Figures) -> Iterable[str]:
    keypoints, width = figures["keypoint_error_px"], figures["diameter_error_px"]
    cut = None if keypoints is None else keypoints["felling_cut"]
    if cut is not None and cut["distance"] is not None:
        yield (
            (
                "For half of the trees found, the predicted felling cut is within"
                f" {cut['distance']['median']:.1f} pixels of the true one"
            )
            + _by_direction(cut)
            + "."
        )
    if width is not None:
        bias = "wide" if width["mean"] >= 0 else "narrow"
        yield (
            f"The diameter has a mean absolute error of {width['mean_abs']:.1f} pixels; on average"
            f" it is {abs(width['mean']):.1f} pixels too {bias}."
        )
    if (cut is not None and cut["distance"] is not None) or width is not None:
        sizes = list(figures["data"]["picture_px"])
        yield f"The image size is {' or '.join(map(escape, sizes[:3]))} pixels" + (
            " and other sizes." if len(sizes) > 3 else "."
        )


def _by_direction(cut: Figures) -> str:
    if cut["across"] is None:
        return ""
    return (
        f" ({cut['across']['median_abs']:.1f} across the trunk,"
        f" {cut['along']['median_abs']:.1f} along it)"
    )


def _group_sentences(figures: Figures) -> Iterable[str]:
    """Return where recall is highest and lowest, for the most important conditions."""
    for axis in list(figures["by"].values())[:_AXES_IN_SUMMARY]:
        groups = [group for group in axis["groups"] if group["trees"] >= FEW_TREES]
        if len(groups) > 1:
            worst = min(groups, key=lambda group: group["recall"])
            best = max(groups, key=lambda group: group["recall"])
            if best["recall"] - worst["recall"] >= 0.1:
                yield (
                    f"By {escape(axis['title'].lower())}, recall is highest for"
                    f" “{escape(best['name'])}” ({100 * best['recall']:.0f} of 100) and lowest for"
                    f" “{escape(worst['name'])}” ({100 * worst['recall']:.0f})."
                )
