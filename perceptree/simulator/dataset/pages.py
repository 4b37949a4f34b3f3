"""The statistics of a dataset as a self-contained HTML page without scripts."""

from __future__ import annotations

import json
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

from perceptree.page import card, grid, render_page, tiles
from perceptree.simulator.dataset.charts import bars_svg, counts_svg, histogram_svg, stacked_svg
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

_TREE_CHARTS = {
    "visible_fraction": ("Visible share of the lower stem", ""),
    "distance_m": ("Distance to the camera, m", " m"),
    "diameter_m": ("Diameter at the cut, m", " m"),
    "diameter_breast_m": ("Diameter at breast height, m", " m"),
    "inclination_deg": ("Inclination of the lower stem, degrees", "°"),
    "box_width_px": ("Box width, px", " px"),
    "box_height_px": ("Box height, px", " px"),
}
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
    write_atomically(directory / FIGURES_FILE, json.dumps(figures, indent=1).encode())
    write_atomically(directory / PAGE_FILE, statistics_page(figures).encode())
    return figures


def statistics_page(figures: Figures) -> str:
    """Make the HTML page of a dataset's statistics."""
    return render_page(
        "What was simulated",
        _header(figures)
        + _splits(figures["splits"])
        + _trees(figures)
        + _conditions(figures)
        + _sensors(figures),
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
        + tiles(shown)
    )


def _splits(splits: Figures) -> str:
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{split['scenes']:,}</td><td>{split['frames']:,}</td>"
        f"<td>{split['trees']:,}</td><td>{split['trees_per_frame']:.2f}</td></tr>"
        for name, split in splits.items()
    )
    return (
        "<h2>Splits</h2>"
        '<div class="card scroll"><table><thead><tr><th>split</th><th>scenes</th><th>frames</th>'
        f"<th>trees</th><th>trees a frame</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _trees(figures: Figures) -> str:
    cards = [
        card("Trees a frame", counts_svg("Trees a frame", figures["trees_per_frame"]["counts"]))
    ]
    for name, (title, unit) in _TREE_CHARTS.items():
        one = figures["tree"][name]
        chart = histogram_svg(title, one["edges"], one["counts"], unit)
        cards.append(card(title, chart, _quantiles(one)))
    cards += [
        card("Species", bars_svg("Species", figures["species"])),
        card("Models of bark and form", bars_svg("Models", figures["models"])),
        _keypoints(figures["keypoints"]),
    ]
    note = "Shares of all labelled trees; what lies beyond an axis is counted in its last bar."
    return f'<h2>Trees</h2><p class="note">{note}</p>{grid(cards)}'


def _quantiles(one: Figures) -> str:
    if "median" not in one:
        return "no tree"
    return f"half are below {one['median']:.3g}; 90 % lie in {one['p5']:.3g} to {one['p95']:.3g}"


def _keypoints(keypoints: Figures) -> str:
    rows = {
        name.replace("_", " "): {flag: flags[flag] for flag in _FLAG_ORDER}
        for name, flags in keypoints.items()
    }
    legend = " ".join(
        f'<span class="key key{index}"></span>{flag}' for index, flag in enumerate(_FLAG_ORDER)
    )
    chart = stacked_svg("Keypoints", rows)
    return (
        f'<div class="card"><h3>Keypoints</h3>{chart}<p class="note">{legend} the frame</p></div>'
    )


def _conditions(figures: Figures) -> str:
    cards = [
        card("Ground", bars_svg("Ground", figures["terrain"]), "frames"),
        _histogram_card("Mean slope of a scene, degrees", figures["slope_deg"], "°"),
        _histogram_card("Stems per hectare of a scene", figures["stems_per_ha"], ""),
        card("Camera carried by", bars_svg("Carrier", figures["carrier"]), "frames"),
    ]
    if figures["realism"]:
        title = "Beyond the paper’s conditions"
        cards.append(card(title, bars_svg(title, figures["realism"]), "frames that have it"))
    return "<h2>Conditions</h2>" + _weather_by_light(figures["weather_by_light"]) + grid(cards)


def _weather_by_light(table: Mapping[str, Mapping[str, int]]) -> str:
    """Table of the number of frames by weather and light, coloured by number."""
    lights = list(next(iter(table.values())))
    most = max(1, *(count for row in table.values() for count in row.values()))
    head = "".join(f"<th>{escape(light)}</th>" for light in lights)
    rows = ""
    for weather, row in table.items():
        cells = "".join(
            f'<td style="--share:{100 * row[light] / most:.0f}%">{row[light]:,}</td>'
            for light in lights
        )
        rows += f"<tr><td>{escape(weather)}</td>{cells}<td>{sum(row.values()):,}</td></tr>"
    sums = [sum(row[light] for row in table.values()) for light in lights]
    last = "".join(f"<td>{count:,}</td>" for count in [*sums, sum(sums)])
    return (
        '<div class="card scroll"><h3>Frames of each weather by light</h3>'
        f'<table class="heat"><thead><tr><th>weather</th>{head}<th>all</th></tr></thead>'
        f"<tbody>{rows}</tbody><tfoot><tr><td>all</td>{last}</tr></tfoot></table></div>"
    )


def _sensors(figures: Figures) -> str:
    valid = figures["depth_valid_share"]
    shares = ", ".join(f"{kind} {100 * valid[kind]:.0f} %" for kind in valid if kind != "all")
    size = figures["bytes_per_frame"]
    kilobytes = {name: round(count / 1000) for name, count in size["folders"].items()}
    cards = [
        card(
            "Depth sensor",
            bars_svg("Depth sensor", figures["depth_sensor"]),
            f"frames; pixels with a reading: {shares}",
        ),
        card(
            "Files of a frame, kB",
            bars_svg("Files of a frame", kilobytes),
            f"mean {size['mean'] / 1000:.0f} kB, at most {size['largest'] / 1000:.0f} kB",
        ),
    ]
    return f"<h2>Sensors and files</h2>{grid(cards)}"


def _histogram_card(title: str, one: dict[str, Any], unit: str) -> str:
    return card(title, histogram_svg(title, one["edges"], one["counts"], unit), _quantiles(one))
