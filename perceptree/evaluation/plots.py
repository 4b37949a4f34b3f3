"""Plots of the evaluation report as inline SVG that follows the page's light or dark theme."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from perceptree.evaluation.errors_px import PixelErrors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Figures = dict[str, Any]

# Placeholders for the page's theme colours.
_PAGE_COLOURS = {"#5a675e": "var(--soft)", "#dfded4": "var(--line)", "#2c6a48": "var(--accent)"}
_SOFT, _LINE, _ACCENT = _PAGE_COLOURS
BLUE, ORANGE = "#3b7dc4", "#e08a2e"
_PANELS = (
    ("a", "felling_cut"),
    ("b", "diameter_right"),
    ("c", "axis_middle"),
    (None, None),
    ("e", "diameter_left"),
    ("f", "axis_top"),
)
_PAGE_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 10.0,
    "axes.edgecolor": _LINE,
    "axes.labelcolor": _SOFT,
    "axes.titlecolor": _SOFT,
    "axes.titlesize": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": _LINE,
    "text.color": _SOFT,
    "xtick.color": _SOFT,
    "ytick.color": _SOFT,
    "legend.frameon": False,
}


def curves_svg(figures: Figures) -> str:
    """Plot precision against recall at an overlap of 0.50."""
    with _style("curves"):
        figure = _figure(5.2, 3.6)
        axes = figure.add_subplot()
        colours = {"boxes": _ACCENT, "masks": ORANGE, "keypoints": BLUE}
        for kind, curve in figures["precision_at_recall"].items():
            if curve is not None:
                recalls = np.linspace(0, 100, len(curve))
                axes.plot(recalls, 100 * np.array(curve), color=colours[kind], label=kind, lw=2)
        axes.set(
            xlim=(0, 100),
            ylim=(0, 102),
            xlabel="recall, % of trees found",
            ylabel="precision, % of detections that are trees",
        )
        axes.legend(loc="lower left")
        return _svg(figure)


def scores_svg(figures: Figures) -> str:
    """Plot recall and precision against the score threshold."""
    with _style("scores"):
        figure = _figure(5.2, 3.6)
        axes = figure.add_subplot()
        rows = figures["boxes_by_score"]
        scores = [row["score"] for row in rows]
        for name, colour, label in (
            ("recall", _ACCENT, "recall, %"),
            ("precision", ORANGE, "precision, %"),
        ):
            values = [float("nan") if row[name] is None else 100 * row[name] for row in rows]
            axes.plot(scores, values, color=colour, label=label, lw=2)
        axes.set(xlim=(0, 1), ylim=(0, 102), xlabel="score threshold")
        axes.legend(loc="lower left")
        return _svg(figure)


def reliability_svg(figures: Figures) -> str:
    """Plot the share of right detections against their score; the diagonal is the ideal."""
    with _style("reliability"):
        figure = _figure(5.2, 3.6)
        axes = figure.add_subplot()
        bins = [each for each in figures["reliability"]["bins"] if each["detections"]]
        axes.plot([0, 1], [0, 100], color=_SOFT, lw=1, ls="--", label="score is the probability")
        axes.bar(
            [(each["from"] + each["to"]) / 2 for each in bins],
            [100 * each["right"] for each in bins],
            width=0.085,
            color=_ACCENT,
            label="labelled trees among them, %",
        )
        axes.set(xlim=(0, 1), ylim=(0, 102), xlabel="score of the detections")
        axes.legend(loc="upper left")
        return _svg(figure)


def directions_svg(figures: Figures) -> str:
    """Plot the paper's figure 4: horizontal and vertical keypoint errors, felling cut density."""
    with _style("directions"):
        figure = _figure(10.4, 5.4)
        for panel, (letter, name) in enumerate(_PANELS, start=1):
            axes = figure.add_subplot(2, 3, panel)
            if letter is None or name is None:
                _draw_density(axes, figures["felling_cut_density"])
                continue
            errors = figures["keypoint_error_px"][name]
            _two_histograms(axes, errors, "horizontal", "vertical")
            axes.set_title(f"({letter}) {name.replace('_', ' ')}")
        return _svg(figure)


def stem_directions_svg(figures: Figures) -> str:
    """Plot the errors of each keypoint across and along the trunk's axis."""
    with _style("stem"):
        figure = _figure(10.4, 5.4)
        for panel, (name, errors) in enumerate(figures["keypoint_error_px"].items(), start=1):
            axes = figure.add_subplot(2, 3, panel)
            _two_histograms(axes, errors, "across", "along")
            axes.set_title(name.replace("_", " "))
        return _svg(figure)


def diameters_svg(figures: Figures, errors: PixelErrors) -> str:
    """Plot predicted against true diameters in px, and a histogram of the errors."""
    with _style("diameters"):
        figure = _figure(10.4, 3.8)
        axes = figure.add_subplot(1, 2, 1)
        known = np.isfinite(errors.true_width)
        true, found = errors.true_width[known], errors.found_width[known]
        top_px = 1.05 * float(np.percentile(np.concatenate([true, found]), 99.5))
        axes.plot([0, top_px], [0, top_px], color=_SOFT, lw=1, ls="--")
        axes.plot(
            np.minimum(true, top_px), np.minimum(found, top_px), ".", color=_ACCENT, alpha=0.5
        )
        axes.set(
            xlim=(0, top_px),
            ylim=(0, top_px),
            xlabel="true diameter, px",
            ylabel="predicted diameter, px",
            aspect="equal",
        )
        axes = figure.add_subplot(1, 2, 2)
        _bars(axes, figures["diameter_error_px"]["histogram"], _ACCENT, None)
        axes.set(xlabel="too narrow  ←  px  →  too wide", ylabel="trees")
        return _svg(figure)


def _two_histograms(axes: Axes, errors: Figures, first: str, second: str) -> None:
    """Draw two histograms over the same range, semi-transparent."""
    for direction, colour in ((first, BLUE), (second, ORANGE)):
        spread = errors[direction]
        if spread is not None:
            label = f"{direction}, σ {spread['sigma']:.1f}"
            _bars(axes, spread["histogram"], colour, label)
    axes.set_xlabel("px")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper right", fontsize=8, handlelength=1.2)


def _bars(axes: Axes, counts: Figures, colour: str, label: str | None) -> None:
    edges = np.linspace(counts["from_px"], counts["to_px"], len(counts["counts"]) + 1)
    axes.stairs(counts["counts"], edges, fill=True, color=colour, alpha=0.55, label=label)


def _draw_density(axes: Axes, found: Figures | None) -> None:
    axes.set_title("(d) felling cut, density")
    axes.grid(False)
    if found is None:
        return
    low, high = found["from_px"], found["to_px"]
    counts = _smoothed(np.array(found["rows"], float))
    axes.imshow(counts, extent=(low, high, high, low), cmap="YlGnBu_r", interpolation="bilinear")
    axes.axhline(0, color="white", lw=0.6, alpha=0.7)
    axes.axvline(0, color="white", lw=0.6, alpha=0.7)
    axes.set(xlabel="px to the right", ylabel="px downwards")


def _smoothed(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smooth the counts, so that few trees give a readable map."""
    import cv2

    return np.asarray(cv2.GaussianBlur(counts, (0, 0), 1.0), np.float64)


def _style(name: str) -> Any:
    """Return the style of a plot; its name makes the SVG ids unique on the page."""
    import matplotlib

    return matplotlib.rc_context({**_PAGE_STYLE, "svg.hashsalt": name})


def _figure(width_in: float, height_in: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def _svg(figure: Figure) -> str:
    """Return the plot as SVG in the page's colours."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    for colour, own in _PAGE_COLOURS.items():
        text = text.replace(colour, own)
    return text[text.index("<svg") :]
