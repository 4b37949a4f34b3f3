"""The report: a self-contained HTML file without scripts."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

from edgetree.demo.comparison import GROSS_DIAMETER_SHARE, GROSS_STDS
from edgetree.demo.plot import error_histogram, scatter_plot
from edgetree.demo.result import DemoResult, ModelResult, Picture
from edgetree.demo.tables import MODEL_LABELS, QUANTITY_STYLES, frame_table, model_table
from edgetree.report.page import figure, page_end, page_start, plot_tiles, scrolling, tiles

__all__ = ["NextCommand", "render_report"]


class NextCommand(NamedTuple):
    """A suggestion at the end of the report: its purpose and the command."""

    purpose: str
    command: str


def render_report(result: DemoResult, next_commands: Sequence[NextCommand]) -> str:
    """The report as HTML text, including pictures and styles."""
    body = "".join(
        (
            _header(result),
            _plain_words(result.models[0]),
            _chain(result),
            _agreement(result.models),
            _errors(result.models),
            _frames(result),
            f"<h2>The models</h2>{model_table(result.models)}",
            _how_it_works(),
            _next(next_commands),
            _footer(result),
        )
    )
    return page_start("edgetree: trees in metres") + body + page_end()


def _header(result: DemoResult) -> str:
    model = result.models[0]
    who = MODEL_LABELS[model.modality].lower()
    entries = [
        (f"{model.found_trees} of {model.true_trees}", f"labelled trees found by the {who}"),
        (_median_text(model, "diameter_m"), "median error of the stem diameter"),
        (_median_text(model, "cut_height_m"), "median error of the felling cut's height"),
        (
            str(model.unmatched_detections),
            f"invented trees: detections of the {who} without a labelled tree",
        ),
        (f"{model.speed.fps:.0f}", "frames per second on this computer's processor"),
    ]
    return (
        "<h1>Trees in metres</h1>"
        f'<p class="lead">{len(model.frames)} forest frames, their trees '
        "found, measured and compared with the truth.</p>"
        f"{tiles(entries)}"
    )


def _median_text(model: ModelResult, quantity: str) -> str:
    """The median error with its unit, or a dash."""
    error_m = model.summary(quantity).median_abs_error_m
    style = QUANTITY_STYLES[quantity]
    return "–" if error_m is None else f"{style.text(error_m)} {style.unit}"


def _plain_words(model: ModelResult) -> str:
    """A summary for readers without knowledge of neural networks."""
    diameter = model.summary("diameter_m")
    missed = model.true_trees - model.found_trees
    sentences = [
        f"The camera looked at {len(model.frames)} places in a simulated forest. They hold "
        f"{model.true_trees} labelled trees; the {MODEL_LABELS[model.modality].lower()} found "
        f"{model.found_trees} and missed {missed}."
    ]
    if diameter.within_one_std is not None and diameter.within_two_std is not None:
        sentences.append(
            f"On half of the {diameter.measured} stems it measured, the diameter is within "
            f"{_median_text(model, 'diameter_m')} of the truth, the height of the felling cut "
            f"within {_median_text(model, 'cut_height_m')}, and the distance within "
            f"{_median_text(model, 'distance_m')}."
        )
        sentences.append(
            "Each value comes with its standard deviation (±), an estimate of its error. If that "
            "estimate is right, 68 of 100 true values lie within one standard deviation, and 95 "
            f"within two. Of the diameters here, {diameter.within_one_std * 100:.0f} of 100 lie "
            f"within one, and {diameter.within_two_std * 100:.0f} within two."
        )
    sentences.append(
        "If a value could not be measured, the table gives the reason. The model was trained on "
        "simulated forest only: expect worse results on real trees until it has been trained on "
        "them."
    )
    return "<h2>In plain words</h2>" + "".join(f"<p>{sentence}</p>" for sentence in sentences)


def _chain(result: DemoResult) -> str:
    """The steps from simulation to the model file, if the demonstration trained one."""
    if not result.steps:
        return ""
    rows = "".join(
        f"<tr><td>{escape(step.name)}</td><td>{escape(step.outcome)}</td>"
        f"<td>{step.duration_s:.0f} s</td></tr>"
        for step in result.steps
    )
    return "<h2>From nothing to this model</h2>" + scrolling(
        '<table class="text"><thead><tr><th>step</th><th>outcome</th><th>time</th></tr>'
        f"</thead><tbody>{rows}</tbody></table>"
    )


def _agreement(models: Sequence[ModelResult]) -> str:
    """A scatter plot for each measured quantity."""
    plots = [plot for quantity in QUANTITY_STYLES if (plot := scatter_plot(models, quantity))]
    if not plots:
        return ""
    return (
        "<h2>Measured and true values</h2>"
        f'<p class="note">{_legend(models)}; bars are one standard deviation; the dashed line is '
        "the truth.</p>"
        f"{plot_tiles(plots)}"
    )


def _legend(models: Sequence[ModelResult]) -> str:
    """The models in their colours."""
    return " and ".join(
        f'<span class="{"first" if index == 0 else "second"}">● '
        f"{MODEL_LABELS[model.modality].lower()}</span>"
        for index, model in enumerate(models)
    )


def _errors(models: Sequence[ModelResult]) -> str:
    """A histogram of the errors of each measured quantity."""
    plots = [plot for quantity in QUANTITY_STYLES if (plot := error_histogram(models, quantity))]
    if not plots:
        return ""
    return (
        "<h2>Errors</h2>"
        f'<p class="note">Measured minus true value: {_legend(models)}; '
        '<span class="gross">■ gross errors</span> are larger than '
        f"{GROSS_STDS:g} standard deviations, for diameters also those larger than "
        f"{GROSS_DIAMETER_SHARE:.0%} of the diameter. The first and the last bar also count all "
        "errors beyond them.</p>"
        f"{plot_tiles(plots)}"
    )


def _frames(result: DemoResult) -> str:
    """Pictures and table of each frame."""
    parts = [
        "<h2>The frames</h2>",
        '<p class="note">Drawn on: the box and the visible stem of each detection, its five '
        "points (felling cut, left and right edge for the diameter, two on the axis), and the "
        "measurements. Trees are numbered from near to far, in pictures and tables alike; a "
        "question mark marks a detection that matches no labelled tree. Click a picture to enlarge "
        "it.</p>",
    ]
    for index, frame in enumerate(result.models[0].frames):
        figures = "".join(_figure(p) for p in result.pictures if p.frame == frame.frame)
        parts.append(
            f'<section class="card"><h3>Frame {index + 1}: {escape(frame.frame)}</h3>'
            f'<div class="pair">{figures}'
            f"</div>{frame_table(result.models, index)}</section>"
        )
    return "".join(parts)


def _figure(picture: Picture) -> str:
    sight = {
        "depth": "the depth image (near is light)",
        "rgb": "the colour image",
    }
    caption = (
        f"What the {MODEL_LABELS[picture.modality].lower()} found in {sight[picture.modality]}"
    )
    size_px = (picture.width_px, picture.height_px)
    return figure(picture.jpeg, size_px, caption, f"{caption}: {picture.frame}")


def _how_it_works() -> str:
    return (
        "<h2>How it was measured</h2>"
        "<p>A detection matches a labelled tree if the intersection over union of their boxes is "
        "at least 0.5. Metres are computed from the depth image and the camera's calibration. The "
        "stem's cross-section is taken as a circle and its two edges as tangents, so that near "
        "and thick stems are not measured too thin. Heights are measured along gravity from the "
        "ground around the stem, on a slope from the uphill side. Distance is from the camera to "
        "the stem's axis at the cut. The time per frame includes all steps from the image to "
        "boxes, masks and points.</p>"
    )


def _next(commands: Sequence[NextCommand]) -> str:
    return "<h2>What to type next</h2>" + "".join(
        f"<p>{escape(purpose)}</p><pre><code>{escape(command)}</code></pre>"
        for purpose, command in commands
    )


def _footer(result: DemoResult) -> str:
    memory = result.peak_memory_mib
    within = "" if memory is None else f" and {memory:.0f} MiB of memory"
    return (
        f'<footer class="note">Made by edgetree in {result.duration_s:.0f} s{within} on '
        f"{escape(platform.system())} {escape(platform.machine())}, Python "
        f"{platform.python_version()}. Apache License 2.0.</footer>"
    )
