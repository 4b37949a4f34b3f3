"""The report: a self-contained HTML file without scripts."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from html import escape
from typing import Final, NamedTuple

from basetree.page import charts, parts
from edgetree.check.quantities import OUTLIER_STDS
from edgetree.demo.comparison import GROSS_DIAMETER_SHARE
from edgetree.demo.plot import error_histogram, scatter_plot
from edgetree.demo.result import DemoResult, ModelResult
from edgetree.demo.tables import SHOWN, error_text, frame_table, model_table

_GROSS: Final = charts.key("gross", "■")


class NextCommand(NamedTuple):
    """A suggestion at the end of the report: its purpose and the command."""

    purpose: str
    command: str


def render_report(result: DemoResult, next_commands: Sequence[NextCommand]) -> str:
    """The report as HTML text, including pictures and styles."""
    return parts.whole(
        "edgetree: trees in metres",
        _header(result.models[0]),
        _plain_words(result.models[0]),
        _chain(result),
        _agreement(result.models),
        _errors(result.models),
        _frames(result.models),
        parts.heading("The models"),
        model_table(result.models),
        _how_it_works(),
        _next(next_commands),
        _footer(result),
    )


def _header(model: ModelResult) -> str:
    who = model.label
    entries = [
        (f"{model.found_trees} of {model.true_trees}", f"labelled trees found by the {who}"),
        (
            error_text(model, "diameter_m"),
            "median error of the stem diameter, from the depth images",
        ),
        (error_text(model, "cut_height_m"), "median error of the felling cut's height"),
        (
            str(model.unmatched_detections),
            f"false detections: of the {who}, where no tree is labelled",
        ),
        (f"{model.fps:.0f}", "frames per second on this computer's processor"),
    ]
    return (
        "<h1>Trees in metres</h1>"
        f'<p class="lead">{len(model.frames)} forest frames, their trees '
        "found, measured and compared with the truth.</p>"
        f"{parts.tiles(entries)}"
    )


def _plain_words(model: ModelResult) -> str:
    """A summary for readers without knowledge of neural networks."""
    diameter = model.summary("diameter_m")
    missed = model.true_trees - model.found_trees
    sentences = [
        f"The camera looked at {len(model.frames)} places in a simulated forest. They hold "
        f"{model.true_trees} labelled trees; the {model.label} found "
        f"{model.found_trees} and missed {missed}."
    ]
    if diameter.within_one_std is not None and diameter.within_two_std is not None:
        sentences.append(
            f"On half of the {diameter.measured} stems it measured, the diameter is within "
            f"{error_text(model, 'diameter_m')} of the truth, the height of the felling cut "
            f"within {error_text(model, 'cut_height_m')}, and the distance within "
            f"{error_text(model, 'distance_m')}."
        )
        sentences.append(
            "Each value comes with its standard deviation (±), an estimate of its error. If that "
            "estimate is right, 77 of 100 true values lie within one standard deviation, and 95 "
            f"within two. Of the diameters here, {diameter.within_one_std * 100:.0f} of 100 lie "
            f"within one, and {diameter.within_two_std * 100:.0f} within two."
        )
    sentences.append(
        "If a value could not be measured, the table gives the reason. The model was trained on "
        "simulated forest only: expect worse results on real trees until it has been trained on "
        "them."
    )
    return parts.heading("In plain words") + "".join(f"<p>{sentence}</p>" for sentence in sentences)


def _chain(result: DemoResult) -> str:
    """The steps from simulation to the model file, if the demonstration trained one."""
    if not result.steps:
        return ""
    rows = ([name, outcome, f"{time_s:.0f} s"] for name, outcome, time_s in result.steps)
    steps = parts.table(["step", "outcome", "time"], rows, kind="text")
    return parts.heading("From nothing to this model") + steps


def _agreement(models: Sequence[ModelResult]) -> str:
    """A scatter plot for each measured quantity."""
    plots = [plot for quantity in SHOWN if (plot := scatter_plot(models, quantity))]
    if not plots:
        return ""
    words = f"{_legend(models)}; bars are one standard deviation; the dashed line is the truth."
    return parts.heading("Measured and true values", words) + parts.grid(plots)


def _legend(models: Sequence[ModelResult]) -> str:
    """The models in their colours."""
    return charts.legend(enumerate(model.label for model in models))


def _errors(models: Sequence[ModelResult]) -> str:
    """A histogram of the errors of each measured quantity."""
    plots = [plot for quantity in SHOWN if (plot := error_histogram(models, quantity))]
    if not plots:
        return ""
    return parts.heading(
        "Errors",
        f"Measured minus true value: {_legend(models)}; {_GROSS} gross errors"
        f" are larger than {OUTLIER_STDS:g} standard deviations, for diameters also those larger"
        f" than {GROSS_DIAMETER_SHARE:.0%} of the diameter. The first and the last bar also count"
        " all errors beyond them.",
    ) + parts.grid(plots)


def _frames(models: Sequence[ModelResult]) -> str:
    """Pictures and table of each frame."""
    words = (
        "Drawn on: the box and the visible stem of each detection, its five points (felling cut,"
        " left and right edge for the diameter, two on the axis), and the measurements. Trees are"
        " numbered from near to far, in pictures and tables alike; a question mark marks a"
        " detection that matches no labelled tree. Click a picture to enlarge it."
    )
    cards = [parts.heading("The frames", words)]
    for index, frame in enumerate(models[0].frames):
        figures = parts.grid((_figure(model, index) for model in reversed(models)), "wide")
        content = figures + frame_table(models, index)
        cards.append(parts.card(f"Frame {index + 1}: {frame.frame}", content))
    return "".join(cards)


def _figure(model: ModelResult, index: int) -> str:
    frame = model.frames[index]
    takes_depth = model.manifest.takes_depth
    sight = "the depth image (near is light)" if takes_depth else "the colour image"
    caption = f"What the {model.label} found in {sight}"
    picture = frame.picture
    return "" if picture is None else parts.figure(picture, caption, f"{caption}: {frame.frame}")


def _how_it_works() -> str:
    return (
        parts.heading("How it was measured")
        + "<p>A detection matches a labelled tree if the intersection over union of their boxes is "
        "at least 0.5. Metres are computed from the depth image and the camera's calibration. The "
        "stem's cross-section is taken as a circle and its two edges as tangents, so that near "
        "and thick stems are not measured too thin. Heights are measured along gravity from the "
        "ground around the stem, on a slope from the uphill side. Distance is from the camera to "
        "the stem's axis at the cut. The time per frame includes all steps from the image to "
        "boxes, masks and points.</p>"
    )


def _next(commands: Sequence[NextCommand]) -> str:
    return parts.heading("What to type next") + "".join(
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
