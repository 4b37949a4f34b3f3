"""Charts of the evaluation report, with their legends below them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from basetree.page import charts, parts
from basetree.page.axis import Axis
from perceptree.evaluation.errors_px import PixelErrors

Figures = dict[str, Any]

_WIDE_PX, _PANEL_PX, _SQUARE_PX, _MAP_PX = (460, 300), (340, 210), (340, 342), (208, 210)
_PANELS = (
    ("a", "felling_cut"),
    ("b", "diameter_right"),
    ("c", "axis_middle"),
    ("d", None),
    ("e", "diameter_left"),
    ("f", "axis_top"),
)
_DENSITY_BGR = (104, 138, 44)


def curves(figures: Figures) -> str:
    """Plot precision against recall at an overlap of 0.50."""
    plot = charts.Plot(
        Axis.rounded(0, 100, "recall, % of trees found"),
        Axis.rounded(0, 100, "precision, % of detections that are trees"),
        _WIDE_PX,
    )
    lines = {}
    for kind, curve in figures["precision_at_recall"].items():
        percents = [100 * value for value in curve or ()]
        recalls = np.linspace(0, 100, len(percents)).tolist()
        lines[kind] = plot.line(zip(recalls, percents, strict=True))
    return _chart(plot, "precision against recall", lines)


def scores(figures: Figures) -> str:
    """Plot recall and precision against the score threshold."""
    plot = charts.Plot(Axis.rounded(0, 1, "score threshold"), Axis.rounded(0, 100), _WIDE_PX)
    rows = figures["boxes_by_score"]
    lines = {
        f"{name}, %": plot.line(
            (row["score"], 100 * row[name]) for row in rows if row[name] is not None
        )
        for name in ("recall", "precision")
    }
    return _chart(plot, "recall and precision against the score threshold", lines)


def reliability(figures: Figures) -> str:
    """Plot the share of right detections against their score; the diagonal is the ideal."""
    plot = charts.Plot(
        Axis.rounded(0, 1, "score of the detections"), Axis.rounded(0, 100), _WIDE_PX
    )
    bins = figures["reliability"]["bins"]
    edges = [bins[0]["from"], *(each["to"] for each in bins)]
    bars = plot.bars(edges, [100 * (each["right"] or 0) for each in bins])
    names = {"labelled trees among them, %": bars}
    words = "The dashed line is where the score is the probability."
    chart = _chart(plot, "share of labelled trees against the score", names, plot.diagonal())
    return chart + parts.note(words)


def paper_directions(figures: Figures) -> str:
    """Plot the paper's figure 4: horizontal and vertical keypoint errors, felling cut density."""
    errors = figures["keypoint_error_px"]
    return parts.grid(
        _density(letter, figures["felling_cut_density"])
        if name is None
        else _panel(f"({letter}) {_words(name)}", errors[name], ("horizontal", "vertical"))
        for letter, name in _PANELS
    )


def stem_directions(figures: Figures) -> str:
    """Plot the errors of each keypoint across and along the trunk's axis."""
    return parts.grid(
        _panel(_words(name), errors, ("across", "along"))
        for name, errors in figures["keypoint_error_px"].items()
    )


def diameters(figures: Figures, errors: PixelErrors) -> str:
    """Plot predicted against true diameters in px, and a histogram of the errors."""
    known = np.isfinite(errors.true_width)
    true, found = errors.true_width[known], errors.found_width[known]
    end_px = 1.05 * float(np.percentile(np.concatenate([true, found]), 99.5))
    plot = charts.Plot(
        Axis.rounded(0, end_px, "true diameter, px"),
        Axis.rounded(0, end_px, "predicted diameter, px"),
        _SQUARE_PX,
    )
    cloud = charts.series(0, plot.cloud(zip(true.tolist(), found.tolist(), strict=True)))
    scatter = plot.svg("predicted against true diameters", plot.diagonal(), cloud)
    counts = figures["diameter_error_px"]["histogram"]
    plot = _histogram_plot([counts], "too narrow ← px too wide", _WIDE_PX)
    return parts.grid(
        [scatter, plot.svg("errors of the diameter", charts.series(0, _bars(plot, counts)))],
        "halves",
    )


def _chart(
    plot: charts.Plot, name: str, marks: Mapping[str, str], ideal: str = "", kind: str = ""
) -> str:
    """The chart of one series for each name, with a legend; those without marks are left out."""
    shown = [(number, each) for number, each in enumerate(marks) if marks[each]]
    drawn = (charts.series(number, marks[each], kind=kind) for number, each in shown)
    return plot.svg(name, *drawn, ideal) + parts.note(charts.legend(shown))


def _words(name: str) -> str:
    return name.replace("_", " ")


def _panel(title: str, errors: Figures, directions: tuple[str, str]) -> str:
    """Two histograms over the same range, semi-transparent."""
    spreads = {name: errors[name] for name in directions if errors[name] is not None}
    histograms = [spread["histogram"] for spread in spreads.values()]
    if not histograms:
        return parts.note(f"{title}: none")
    plot = _histogram_plot(histograms, "px", _PANEL_PX)
    bars = {
        f"{name}, σ {spread['sigma']:.1f}": _bars(plot, spread["histogram"])
        for name, spread in spreads.items()
    }
    return f"<div>{parts.note(title)}{_chart(plot, title, bars, kind='over')}</div>"


def _histogram_plot(histograms: list[Figures], name: str, size_px: tuple[int, int]) -> charts.Plot:
    low, high = histograms[0]["from_px"], histograms[0]["to_px"]
    most = max(max(each["counts"]) for each in histograms)
    return charts.Plot(
        Axis.rounded(low, high, name, parts=6), Axis.rounded(0, most, "trees", whole=True), size_px
    )


def _bars(plot: charts.Plot, histogram: Figures) -> str:
    counts = histogram["counts"]
    edges = np.linspace(histogram["from_px"], histogram["to_px"], len(counts) + 1)
    return plot.bars(edges.tolist(), counts)


def _density(letter: str, found: Figures | None) -> str:
    """Where the predicted felling cuts are around the true ones, smoothed."""
    title = f"({letter}) felling cut, density"
    if found is None:
        return parts.note(f"{title}: none")
    low, high = found["from_px"], found["to_px"]
    ticks = tuple((value, f"{value:g}") for value in (low, 0.0, high))
    plot = charts.Plot(
        Axis(low, high, ticks, "px to the right"), Axis(high, low, ticks, "px downwards"), _MAP_PX
    )
    counts = cv2.GaussianBlur(np.array(found["rows"], np.float64), (0, 0), 1.0)
    picture = np.full((*counts.shape, 4), (*_DENSITY_BGR, 0), np.uint8)
    picture[..., 3] = np.rint(255 * counts / max(counts.max(), 1e-9))
    cross = plot.line([(low, 0), (high, 0)], "axis") + plot.line([(0, low), (0, high)], "axis")
    drawn = plot.picture(cv2.imencode(".png", picture)[1].tobytes())
    return f"<div>{parts.note(title)}{plot.svg(title, drawn, cross)}</div>"
