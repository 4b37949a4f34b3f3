"""HTML page of an evaluation, for forestry and for machine learning readers."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from perceptree.drawing import KEYPOINT_COLOURS
from perceptree.evaluation.gallery import FOUND, TRUTH, ExampleImage, example_images
from perceptree.evaluation.plots import (
    curves_svg,
    diameters_svg,
    directions_svg,
    reliability_svg,
    scores_svg,
    stem_directions_svg,
)
from perceptree.evaluation.summary import title_of
from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.page import card, render_page, tiles

if TYPE_CHECKING:
    from perceptree.evaluation.report import Report

Figures = dict[str, Any]

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
_FEW_TREES = 20
_AXES_IN_SUMMARY = 3
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


def report_page(report: Report) -> str:
    """Render the whole page as HTML text with its plots and images."""
    figures = report.figures
    title = title_of(figures)
    parts = [
        _header(figures),
        _summary(figures),
        _precision(figures),
        _keypoints(figures),
        _diameters(report),
        _groups(figures),
        _pictures(report),
        _method(figures),
    ]
    return render_page(f"Evaluation of {title}", "".join(parts))


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
        f" {escape(str(data['folder']))}, {escape(data['split'])}.</p>" + tiles(entries)
    )


def _summary(figures: Figures) -> str:
    """Return a summary in words, for readers who know trees rather than networks."""
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
    return "<h2>Summary</h2>" + "".join(f"<p>{text}</p>" for text in texts if text)


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
        groups = [group for group in axis["groups"] if group["trees"] >= _FEW_TREES]
        if len(groups) > 1:
            worst = min(groups, key=lambda group: group["recall"])
            best = max(groups, key=lambda group: group["recall"])
            if best["recall"] - worst["recall"] >= 0.1:
                yield (
                    f"By {escape(axis['title'].lower())}, recall is highest for"
                    f" “{escape(best['name'])}” ({100 * best['recall']:.0f} of 100) and lowest for"
                    f" “{escape(worst['name'])}” ({100 * worst['recall']:.0f})."
                )


def _precision(figures: Figures) -> str:
    rows = ""
    for kind, found in figures["average_precision"].items():
        cells = "".join(
            f"<td>{_number(None if found is None else found[name])}</td>" for name in _PRECISIONS
        )
        rows += f"<tr><td>{kind}</td>{cells}</tr>"
    head = "".join(f"<th>{name}</th>" for name in _PRECISIONS.values())
    table = (
        f'<div class="scroll"><table><thead><tr><th></th>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )
    note = (
        "COCO's average precision, 0 to 100: the area under the precision-recall curve, averaged"
        " over overlap thresholds of 0.50 to 0.95. AP50 and AP75 use an overlap of 0.50 or 0.75."
        " Small trees have a visible area of less than 32² px, large trees of more than 96² px. The"
        " overlap of keypoints is the object keypoint similarity (OKS) with sigmas of 0.25."
    )
    curves = [
        card(
            "Precision and recall",
            f'<div class="plot">{curves_svg(figures)}</div>',
            "At an overlap threshold of 0.50.",
        )
    ]
    if figures["boxes_by_score"] is not None:
        curves.append(
            card(
                "Precision and recall by score threshold",
                f'<div class="plot">{scores_svg(figures)}</div>',
                "Boxes; detections are shown from a score of 0.5 by default.",
            )
        )
    fit = figures["reliability"]
    if fit["detections"]:
        curves.append(
            card(
                "Are scores probabilities?",
                f'<div class="plot">{reliability_svg(figures)}</div>',
                f"{fit['detections']:,} detections with a score of {fit['least_score']} and more."
                " Score and share of labelled trees differ by"
                f" {100 * fit['expected_error']:.1f} percentage points on average.",
            )
        )
    return (
        "<h2>Average precision</h2>"
        f'<div class="card">{table}<p class="note">{escape(note)}</p></div>'
        f'<div class="grid halves">{"".join(curves)}</div>'
    )


def _keypoints(figures: Figures) -> str:
    keypoints = figures["keypoint_error_px"]
    if keypoints is None:
        return ""
    rows = "".join(_keypoint_row(name, errors) for name, errors in keypoints.items())
    table = (
        '<div class="card scroll"><table><thead><tr><th>keypoint</th><th>trees</th>'
        "<th>median, px</th><th>mean, px</th><th>90th percentile, px</th>"
        "<th>across: mean&nbsp;±&nbsp;σ</th><th>along: mean&nbsp;±&nbsp;σ</th>"
        "<th>horizontal: mean&nbsp;±&nbsp;σ</th><th>vertical: mean&nbsp;±&nbsp;σ</th></tr></thead>"
        f"<tbody>{rows}</tbody></table>"
        '<p class="note">Trees found with a score of at least 0.5. Positive is to the right of the'
        " trunk (across), towards the top (along), to the right (horizontal) and downwards"
        " (vertical).</p></div>"
    )
    directions = card(
        "Horizontal and vertical errors, as in the paper’s figure 4",
        f'<div class="plot">{directions_svg(figures)}</div>',
    )
    stem = card(
        "Errors across and along the trunk",
        f'<div class="plot">{stem_directions_svg(figures)}</div>',
        "An error across the trunk makes the felling head miss the tree; an error along it makes"
        " the stump too high or too low.",
    )
    return f"<h2>Keypoint errors</h2>{table}<br>{directions}<br>{stem}"


def _keypoint_row(name: str, errors: Figures) -> str:
    distance = errors["distance"]
    if distance is None:
        return f"<tr><td>{name.replace('_', ' ')}</td><td>0</td>{'<td>–</td>' * 7}</tr>"
    spreads = "".join(
        "<td>–</td>"
        if spread is None
        else f"<td>{spread['mean']:+.1f} ± {spread['sigma']:.1f}</td>"
        for spread in (errors[way] for way in ("across", "along", "horizontal", "vertical"))
    )
    return (
        f"<tr><td>{name.replace('_', ' ')}</td><td>{distance['count']:,}</td>"
        f"<td>{distance['median']:.1f}</td><td>{distance['mean']:.1f}</td>"
        f"<td>{distance['p90_abs']:.1f}</td>{spreads}</tr>"
    )


def _diameters(report: Report) -> str:
    width, errors = report.figures["diameter_error_px"], report.measured.errors
    if width is None or errors is None:
        return ""
    note = (
        f"Absolute error: mean {width['mean_abs']:.2f} px, median {width['median_abs']:.2f} px,"
        f" 90th percentile {width['p90_abs']:.2f} px; bias {width['mean']:+.2f} px, standard"
        f" deviation {width['sigma']:.2f} px; {width['count']:,} trees. The paper reports a mean"
        " error of 5.2 px on its own data at 1280x720 px."
    )
    plots = f'<div class="plot">{diameters_svg(report.figures, errors)}</div>'
    return f"<h2>Diameters</h2>{card('Distance of the two diameter points', plots, note)}"


def _groups(figures: Figures) -> str:
    if not figures["by"]:
        return ""
    note = (
        "In each row, trees of other groups are ignored. A false positive has no distance or"
        " species, so in such tables it counts in every row: compare a row with the same row of"
        " another detector, not with other rows. Pale rows have fewer than 20 trees."
    )
    tables = "<br>".join(_group_table(axis) for axis in figures["by"].values())
    if figures["certain"] is not None:
        tables = f"{_certain_table(figures['certain'])}<br>{tables}"
    return f'<h2>Results by condition</h2><p class="note">{note}</p>{tables}'


def _certain_table(certain: Figures) -> str:
    """Return recall by distance with far trees ignored and with all of them counted."""
    graded = {group["name"]: group for group in certain["graded"]["by_distance"]}
    rows = "".join(
        f"<tr><td>{escape(group['name'])}</td>"
        + "".join(_recall_cells(one) for one in (graded.get(group["name"]), group))
        + "</tr>"
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
    return (
        '<div class="card scroll"><h3>Recall by distance under both rules</h3>'
        '<table class="shares"><thead><tr><th></th>'
        f"<th>trees, beyond {limit} ignored</th><th>recall</th>"
        "<th>trees, all counted</th><th>recall</th></tr></thead>"
        f'<tbody>{rows}</tbody></table><p class="note">{totals}</p></div>'
    )


def _recall_cells(group: Figures | None) -> str:
    values = group or {"trees": None, "recall": None}
    return "".join(_group_cell(name, values[name]) for name in ("trees", "recall"))


def _group_table(axis: Figures) -> str:
    groups: Sequence[Figures] = axis["groups"]
    columns = {
        name: head
        for name, head in _GROUP_COLUMNS.items()
        if any(group.get(name) is not None for group in groups)
        and (axis["of_frames"] or name != "frames")
    }
    head = "".join(f"<th>{title}</th>" for title in columns.values())
    rows = ""
    for group in groups:
        cells = "".join(_group_cell(name, group.get(name)) for name in columns)
        few = ' class="few"' if group["trees"] < _FEW_TREES else ""
        rows += f"<tr{few}><td>{escape(group['name'])}</td>{cells}</tr>"
    return (
        f'<div class="card scroll"><h3>{escape(axis["title"])}</h3><table class="shares"><thead>'
        f"<tr><th></th>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _group_cell(name: str, value: float | None) -> str:
    if value is None:
        return "<td>–</td>"
    if name in ("frames", "trees"):
        return f"<td>{value:,}</td>"
    percent = 100 * value if name in _SHARES else value
    if name in _SHARES or name.endswith("_ap"):
        text = f"{percent:.0f} %" if name in _SHARES else f"{percent:.1f}"
        return f'<td style="--share:{percent:.0f}%">{text}</td>'
    return f"<td>{value:+.1f}</td>" if name.endswith("bias_px") else f"<td>{value:.1f}</td>"


def _pictures(report: Report) -> str:
    shown = example_images(report.measured)
    wide = " wide" if report.measured.store.spec.modality == "depth" else ""
    depth = " Left: colour image. Right: depth, near is bright." if wide else ""
    truth, found = (f"rgb({red}, {green}, {blue})" for blue, green, red in (TRUTH, FOUND))
    parts = [
        "<h2>Examples</h2>"
        f'<p class="note"><span class="mark" style="color:{truth}"></span>label, keypoints as'
        f' rings <span class="mark" style="color:{found}"></span>detection, keypoints as discs.'
        f"{depth} Other boxes are drawn faintly.<br>{_point_legend()}</p>"
    ]
    for name, (title, note) in _GALLERIES.items():
        tiles_ = "".join(_example_figure(example) for example in shown[name]) or "<p>None.</p>"
        parts.append(
            f'<h3>{title}</h3><p class="note">{note}</p><div class="gallery{wide}">{tiles_}</div>'
        )
    return "".join(parts)


def _point_legend() -> str:
    """Return the colour and name of every keypoint."""
    return " ".join(
        f'<span class="dot" style="background:rgb({red}, {green}, {blue})"></span>'
        f"{name.replace('_', ' ')}"
        for name, (blue, green, red) in zip(KEYPOINT_NAMES, KEYPOINT_COLOURS, strict=True)
    )


def _example_figure(example: ExampleImage) -> str:
    data = base64.b64encode(example.jpeg).decode("ascii")
    caption = escape(example.caption)
    return (
        f'<figure><img src="data:image/jpeg;base64,{data}" width="{example.width_px}"'
        f' height="{example.height_px}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'
    )


def _method(figures: Figures) -> str:
    shown = figures["at_score"]
    notes = [*figures["data"]["notes"], *(f"left out: {line}" for line in figures["left_out"])]
    notes_html = "".join(f"<li>{escape(line)}</li>" for line in notes)
    model = "".join(
        f"<tr><td>{escape(name.replace('_', ' '))}</td><td>{escape(str(value))}</td></tr>"
        for name, value in figures["model"].items()
        if value is not None
    )
    return (
        "<h2>Method</h2>"
        f"<p>A tree counts as found if a detection with a score of at least {shown['score']}"
        f" overlaps its box by at least {shown['iou']} (intersection over union); each detection"
        " finds one tree. Average precision uses all scores and is computed as in pycocotools."
        " The trunk’s axis is that of the label, from the felling cut to the top point. Pixels are"
        " those of the source images.</p>"
        + (f"<ul>{notes_html}</ul>" if notes_html else "")
        + f'<div class="card scroll"><h3>The model</h3><table class="words"><tbody>{model}'
        "</tbody></table></div>"
    )


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}"
