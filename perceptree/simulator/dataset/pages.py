"""The statistics of a dataset as a self-contained HTML page without scripts."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

from basetree.page import charts, parts
from basetree.page.axis import Axis
from perceptree.simulator.dataset.contact_sheet import DEPTH_SHEET_FILE, SHEET_FILE
from perceptree.simulator.dataset.statistics import (
    PAPER_TREES_PER_FRAME,
    Figures,
    Record,
    dataset_statistics,
)
from perceptree.simulator.dataset.storage import write_atomically

PAGE_FILE = "statistics.html"
FIGURES_FILE = "statistics.json"
_SCHEMA = "perceptree.statistics/1"

_TREE_CHARTS = {
    "visible_fraction": ("Visible share of the lower stem", ""),
    "distance_m": ("Distance to the camera, m", " m"),
    "diameter_m": ("Diameter at the cut, m", " m"),
    "diameter_breast_m": ("Diameter at breast height, m", " m"),
    "inclination_deg": ("Inclination of the lower stem, degrees", "°"),
    "box_width_px": ("Box width, px", " px"),
    "box_height_px": ("Box height, px", " px"),
}
_MAX_LABELS = 18
_SIZE_PX = (340, 170)
_FLAG_ORDER = ("visible", "hidden", "outside")


def write_statistics(directory: Path, splits: dict[str, list[Record]]) -> Figures:
    """Compute the statistics of a dataset, and write them as JSON and as an HTML page.

    Args:
        directory: Folder of the dataset.
        splits: Frame records of each split.

    Returns:
        The statistics.

    Raises:
        OSError: If a file cannot be written.
    """
    figures = dataset_statistics(splits)
    content = json.dumps({"schema": _SCHEMA, **figures}, indent=1)
    write_atomically(directory / FIGURES_FILE, content.encode())
    write_atomically(directory / PAGE_FILE, statistics_page(figures).encode())
    return figures


def statistics_page(figures: Figures) -> str:
    """Make the HTML page of a dataset's statistics."""
    return parts.whole(
        "What was simulated",
        _header(figures),
        _splits(figures["splits"]),
        _trees(figures),
        _conditions(figures),
        _sensors(figures),
    )


def _header(figures: Figures) -> str:
    splits = figures["splits"].values()
    valid = figures["depth_valid_share"]["all"]
    shown = [
        (f"{sum(s['frames'] for s in splits):,}", "frames"),
        (f"{sum(s['scenes'] for s in splits):,}", "scenes, each in one split"),
        (f"{sum(s['trees'] for s in splits):,}", "labelled trees"),
        (
            f"{figures['trees_per_frame']['mean']:.2f}",
            f"trees a frame; the paper has {PAPER_TREES_PER_FRAME}",
        ),
        (f"{100 * valid:.0f} %", "of the depth image has a reading"),
        (f"{figures['bytes_per_frame']['mean'] / 1000:.0f} kB", "a frame, all files"),
    ]
    return (
        "<h1>What was simulated</h1>"
        f'<p class="lead">The frames themselves: <a href="{SHEET_FILE}">colour with labels</a>'
        f' and <a href="{DEPTH_SHEET_FILE}">measured depth</a>, beside this page.</p>'
        + parts.tiles(shown)
    )


def _splits(splits: Figures) -> str:
    rows = (
        [
            name,
            *(f"{split[what]:,}" for what in ("scenes", "frames", "trees")),
            f"{split['trees_per_frame']:.2f}",
        ]
        for name, split in splits.items()
    )
    heads = ["split", "scenes", "frames", "trees", "trees a frame"]
    return parts.heading("Splits") + parts.card("", parts.table(heads, rows))


def _trees(figures: Figures) -> str:
    cards = [
        _number_card("Trees a frame", figures["trees_per_frame"]["counts"]),
        *(
            _histogram_card(title, figures["tree"][name], unit)
            for name, (title, unit) in _TREE_CHARTS.items()
        ),
        _bars_card("Species", figures["species"]),
        _bars_card("Models of bark and form", figures["models"]),
        _keypoints(figures["keypoints"]),
    ]
    note = (
        "Shares of all labelled trees, where nothing else is said; what lies beyond an axis is"
        " counted in its last bar."
    )
    return parts.heading("Trees", note) + parts.grid(cards)


def _bars_card(
    title: str, counts: Mapping[str, int], note: str = "", total: int | None = None
) -> str:
    names = {name.replace("_", " "): count for name, count in counts.items()}
    return parts.card(title, charts.named_bars(title, names, total), note)


def _number_card(title: str, counts: Sequence[int]) -> str:
    """A bar for each of the numbers 0, 1, 2 and so on."""
    every = math.ceil(len(counts) / _MAX_LABELS)
    ticks = tuple((number + 0.5, f"{number}") for number in range(0, len(counts), every))
    axis = Axis(0, len(counts), ticks)
    chart = _columns(title, axis, counts, [f"{n}" for n in range(len(counts))])
    return parts.card(title, chart, "Shares of all frames.")


def _histogram_card(title: str, one: Figures, unit: str) -> str:
    """A histogram of one quantity, with its quantiles."""
    edges = [_figure(edge) for edge in one["edges"]]
    names = [f"{low} to {high}{unit}" for low, high in pairwise(edges)]
    chart = _columns(title, Axis.bins(edges), one["counts"], names)
    return parts.card(title, chart, _quantiles(one))


def _columns(title: str, across: Axis, counts: Sequence[int], names: Sequence[str]) -> str:
    """Bars in percent of all counts; their names are shown when the pointer is on them."""
    percents = [100 * count / max(1, sum(counts)) for count in counts]
    up = Axis.rounded(0, max(percents, default=0.0), text=lambda percent: f"{percent:g} %")
    plot = charts.Plot(across, up, _SIZE_PX)
    hints = [
        f"{name}: {count:,}, {percent:.1f} %"
        for name, count, percent in zip(names, counts, percents, strict=True)
    ]
    return plot.svg(title, charts.series(0, plot.bars(range(len(counts) + 1), percents, hints)))


def _quantiles(one: Figures) -> str:
    if "median" not in one:
        return "no tree"
    median, low, high = (_figure(one[name]) for name in ("median", "p5", "p95"))
    return f"half are below {median}; 90 % lie in {low} to {high}"


def _figure(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _keypoints(keypoints: Figures) -> str:
    rows = [(name.replace("_", " "), _flags(flags)) for name, flags in keypoints.items()]
    legend = " ".join(
        f"{charts.key(f'part{index}', '■')} {flag}" for index, flag in enumerate(_FLAG_ORDER)
    )
    return parts.card("Keypoints", charts.stacked_bars("Keypoints", rows), f"{legend} the frame")


def _flags(flags: Figures) -> list[charts.Part]:
    total = max(1, sum(flags.values()))
    shares = {flag: f"{100 * flags[flag] / total:.0f} %" for flag in _FLAG_ORDER}
    return [
        charts.Part(flags[flag], share, f"{flag}: {flags[flag]:,}, {share}")
        for flag, share in shares.items()
    ]


def _conditions(figures: Figures) -> str:
    cards = [
        _bars_card("Ground", figures["terrain"], "Shares of all frames."),
        _histogram_card("Mean slope, degrees: shares of scenes", figures["slope_deg"], "°"),
        _histogram_card("Stems per hectare: shares of scenes", figures["stems_per_ha"], ""),
        _bars_card("Camera carried by", figures["carrier"], "Shares of all frames."),
    ]
    if realism := figures["realism"]:
        frames = sum(split["frames"] for split in figures["splits"].values())
        note = "Frames that have it, and their share of all frames; a frame may have several."
        cards.append(_bars_card("Beyond the paper’s conditions", realism, note, frames))
    table = _weather_by_light(figures["weather_by_light"])
    return parts.heading("Conditions") + table + parts.grid(cards)


def _weather_by_light(counts: Mapping[str, Mapping[str, int]]) -> str:
    """Table of the number of frames by weather and light, coloured by number."""
    lights = list(next(iter(counts.values())))
    most = max(1, *(count for found in counts.values() for count in found.values()))
    rows: Iterable[parts.Cells] = (
        [
            weather,
            *(parts.share_cell(f"{found[light]:,}", 100 * found[light] / most) for light in lights),
            parts.Cell(f"{sum(found.values()):,}", 'class="none"'),
        ]
        for weather, found in counts.items()
    )
    sums = [sum(found[light] for found in counts.values()) for light in lights]
    foot = ["all", *(f"{count:,}" for count in [*sums, sum(sums)])]
    content = parts.table(["weather", *lights, "all"], rows, foot=foot)
    return parts.card("Frames of each weather by light", content)


def _sensors(figures: Figures) -> str:
    valid = figures["depth_valid_share"]
    shares = ", ".join(f"{kind} {100 * valid[kind]:.0f} %" for kind in valid if kind != "all")
    size = figures["bytes_per_frame"]
    kilobytes = {name: round(count / 1000) for name, count in size["folders"].items()}
    cards = [
        _bars_card(
            "Depth sensor",
            figures["depth_sensor"],
            f"Shares of all frames. Pixels with a reading: {shares}.",
        ),
        _bars_card(
            "Files of a frame, kB",
            kilobytes,
            f"mean {size['mean'] / 1000:.0f} kB, at most {size['largest'] / 1000:.0f} kB",
        ),
    ]
    return parts.heading("Sensors and files") + parts.grid(cards)
