"""HTML page of an evaluation, for forestry and for machine learning readers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

from basetree.page import charts, parts
from perceptree.drawing import KEYPOINT_COLOURS, Colour
from perceptree.evaluation import plots
from perceptree.evaluation.gallery import FOUND, TRUTH, example_images
from perceptree.evaluation.metrics import Measured
from perceptree.evaluation.report_tables import (
    FEW_TREES,
    certain_table,
    group_table,
    keypoint_table,
    precision_table,
)
from perceptree.evaluation.report_words import paragraphs
from perceptree.evaluation.summary import title_of
from perceptree.keypoints import KEYPOINT_NAMES

Figures = dict[str, Any]

_GALLERIES = {
    "best": (
        "Best matches",
        "Fit is the mean of box IoU, mask IoU and keypoint similarity, at most 1.",
    ),
    "worst": ("Worst matches", "Counted as found, but with the lowest fit."),
    "missed": ("Missed trees", "Labelled trees that were not detected, largest first."),
    "invented": (
        "False positives",
        "Detections without a labelled tree, or a second detection of the same tree, highest score"
        " first. Some may be real trees: data sets do not label trees beyond some distance.",
    ),
}


def report_page(figures: Figures, measured: Measured) -> str:
    """Render the whole page as HTML text with its plots and images.

    Args:
        figures: JSON-ready results.
        measured: Predictions and intermediate results, for images and plots.
    """
    return parts.whole(
        f"Evaluation of {title_of(figures)}",
        _header(figures),
        parts.heading("Summary"),
        *(f"<p>{text}</p>" for text in paragraphs(figures)),
        _precision(figures),
        _keypoints(figures),
        _diameters(figures, measured),
        _groups(figures),
        _pictures(measured),
        _method(figures),
    )


def _header(figures: Figures) -> str:
    data, shown, width = figures["data"], figures["at_score"], figures["diameter_error_px"]
    entries = [
        (f"{shown['recall']:.0%}", f"recall: {shown['found']:,} of {data['trees']:,} trees found")
    ]
    if shown["precision"] is not None:
        false = f"{shown['invented']:,} false positives"
        entries.append((f"{shown['precision']:.0%}", f"precision: {false}"))
    entries += [
        (f"{found['ap']:.1f}", f"average precision of {kind}, out of 100")
        for kind, found in figures["average_precision"].items()
        if found is not None
    ]
    if width is not None:
        entries.append((f"{width['mean_abs']:.1f} px", "mean absolute error of the diameter"))
    return (
        f"<h1>{escape(title_of(figures))}</h1>"
        f'<p class="lead">Compared with the labels of {data["frames"]:,} images in'
        f" {escape(str(data['folder']))}, {escape(data['split'])}.</p>" + parts.tiles(entries)
    )


def _precision(figures: Figures) -> str:
    words = (
        "COCO's average precision, 0 to 100: the area under the precision-recall curve, averaged"
        " over overlap thresholds of 0.50 to 0.95. AP50 and AP75 use an overlap of 0.50 or 0.75."
        " Small trees have a visible area of less than 32² px, large trees of more than 96² px. The"
        " overlap of keypoints is the object keypoint similarity (OKS) with sigmas of 0.25."
    )
    shown = [
        parts.card(
            "Precision and recall", plots.curves(figures), "At an overlap threshold of 0.50."
        )
    ]
    if figures["boxes_by_score"] is not None:
        shown.append(
            parts.card(
                "Precision and recall by score threshold",
                plots.scores(figures),
                "Boxes; detections are shown from a score of 0.5 by default.",
            )
        )
    fit = figures["reliability"]
    if fit["detections"]:
        shown.append(
            parts.card(
                "Are scores probabilities?",
                plots.reliability(figures),
                f"{fit['detections']:,} detections with a score of {fit['least_score']} and more."
                " Score and share of labelled trees differ by"
                f" {100 * fit['expected_error']:.1f} percentage points on average.",
            )
        )
    average = parts.card("", precision_table(figures), words)
    return parts.heading("Average precision") + average + parts.grid(shown, "halves")


def _keypoints(figures: Figures) -> str:
    if figures["keypoint_error_px"] is None:
        return ""
    words = (
        "Trees found with a score of at least 0.5. Positive is to the right of the trunk (across),"
        " towards the top (along), to the right (horizontal) and downwards (vertical)."
    )
    paper = parts.card(
        "Horizontal and vertical errors, as in the paper’s figure 4",
        plots.paper_directions(figures),
    )
    stem = parts.card(
        "Errors across and along the trunk",
        plots.stem_directions(figures),
        "An error across the trunk makes the felling head miss the tree; an error along it makes"
        " the stump too high or too low.",
    )
    errors = parts.card("", keypoint_table(figures), words)
    return parts.heading("Keypoint errors") + errors + paper + stem


def _diameters(figures: Figures, measured: Measured) -> str:
    width = figures["diameter_error_px"]
    if width is None or measured.errors is None:
        return ""
    words = (
        f"Absolute error: mean {width['mean_abs']:.2f} px, median {width['median_abs']:.2f} px,"
        f" 90th percentile {width['p90_abs']:.2f} px; bias {width['mean']:+.2f} px, standard"
        f" deviation {width['sigma']:.2f} px; {width['count']:,} trees. The paper reports a mean"
        " error of 5.2 px on its own data at 1280x720 px."
    )
    content = plots.diameters(figures, measured.errors)
    return parts.heading("Diameters") + parts.card(
        "Distance of the two diameter points", content, words
    )


def _groups(figures: Figures) -> str:
    if not figures["by"]:
        return ""
    words = (
        "In each row, trees of other groups are ignored. A false positive has no distance or"
        " species, so in such tables it counts in every row: compare a row with the same row of"
        f" another detector, not with other rows. Pale rows have fewer than {FEW_TREES} trees."
    )
    certain = "" if figures["certain"] is None else certain_table(figures["certain"])
    tables = "".join(group_table(axis) for axis in figures["by"].values())
    return parts.heading("Results by condition", words) + certain + tables


def _pictures(measured: Measured) -> str:
    examples = example_images(measured)
    both = measured.store.spec.modality != "rgb"
    depth = " Left: colour image, where there is one. Right: depth, near is bright." if both else ""
    words = (
        f"{_sign(TRUTH, '□')} label, keypoints as rings {_sign(FOUND, '□')} detection, keypoints"
        f" as discs.{depth} Other boxes are drawn faintly.<br>"
    )
    words += " ".join(
        f"{_sign(colour, '●')} {name.replace('_', ' ')}"
        for name, colour in zip(KEYPOINT_NAMES, KEYPOINT_COLOURS, strict=True)
    )
    shown = [parts.heading("Examples", words)]
    for name, (title, what) in _GALLERIES.items():
        figures = [parts.figure(jpeg, escape(caption), caption) for jpeg, caption in examples[name]]
        pictures = parts.grid(figures, "wide" if both else "small") if figures else "<p>None.</p>"
        shown.append(f"<h3>{title}</h3>{parts.note(what)}{pictures}")
    return "".join(shown)


def _sign(colour: Colour, sign: str) -> str:
    """A sign of the legend in a colour of the pictures."""
    blue, green, red = colour
    return charts.key("", sign, f"rgb({red}, {green}, {blue})")


def _settings(name: str, value: object) -> Iterator[list[str]]:
    """Name and value of each setting, also of those inside others."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _settings(f"{name}, {key}".removeprefix(", ").replace("_", " "), inner)
    elif isinstance(value, list | tuple) and not any(isinstance(one, Mapping) for one in value):
        yield [name, ", ".join(map(str, value))]
    elif isinstance(value, list | tuple):
        yield [name, str(len(value))]
    elif value is not None:
        yield [name, str(value)]


def _method(figures: Figures) -> str:
    shown = figures["at_score"]
    notes = [*figures["data"]["notes"], *(f"left out: {line}" for line in figures["left_out"])]
    notes_html = "".join(f"<li>{escape(line)}</li>" for line in notes)
    rows = _settings("", figures["model"])
    return (
        parts.heading("Method")
        + f"<p>A tree counts as found if a detection with a score of at least {shown['score']}"
        f" overlaps its box by at least {shown['iou']} (intersection over union); each detection"
        " finds one tree. Average precision uses all scores and is computed as in pycocotools."
        " The trunk’s axis is that of the label, from the felling cut to the top point. Pixels are"
        " those of the source images.</p>"
        + (f"<ul>{notes_html}</ul>" if notes_html else "")
        + parts.card("The model", parts.table([], rows, kind="text"))
    )
