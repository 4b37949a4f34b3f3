"""The evaluation's page: for people who fell trees, and for people who train networks."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from perceptree.drawing import KEYPOINT_COLOURS
from perceptree.evaluation.gallery import FOUND, TRUTH, Exhibit, galleries
from perceptree.evaluation.plots import (
    curves_svg,
    diameters_svg,
    directions_svg,
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
    "frames": "pictures",
    "trees": "trees",
    "recall": "found",
    "precision": "reported rightly",
    "boxes_ap": "box AP",
    "masks_ap": "mask AP",
    "keypoints_ap": "keypoint AP",
    "felling_cut_median_px": "cut off, px",
    "diameter_mean_abs_px": "diameter off, px",
    "diameter_bias_px": "diameter bias, px",
}
_SHARES = ("recall", "precision")
_FEW_TREES = 20
_AXES_IN_WORDS = 3
_GALLERIES = {
    "best": (
        "Found best",
        "Fit is the mean of the overlaps of boxes and outlines and of the points’ similarity, at"
        " most 1.",
    ),
    "worst": ("Found worst", "Counted as found, but with the poorest fit."),
    "missed": ("Missed", "Labelled trees that were not reported, largest first."),
    "invented": (
        "Invented",
        "Reported, surest first, where no tree is labelled, or a second time on the same tree. Look"
        " for real trees among them: beyond some distance data sets label none.",
    ),
}


def report_page(report: Report) -> str:
    """The whole page as HTML text, plots and pictures included."""
    figures = report.figures
    title = title_of(figures)
    parts = [
        _header(figures),
        _plain_words(figures),
        _precision(figures),
        _keypoints(figures),
        _diameters(report),
        _groups(figures),
        _pictures(report),
        _method(figures),
    ]
    return render_page(f"How good is {title}?", "".join(parts))


def _header(figures: Figures) -> str:
    data, shown, width = figures["data"], figures["at_score"], figures["diameter_error_px"]
    entries = [
        (f"{shown['recall']:.0%}", f"of the trees found: {shown['found']:,} of {data['trees']:,}")
    ]
    if shown["precision"] is not None:
        invented = f"{shown['invented']:,} are not"
        entries.append(
            (f"{shown['precision']:.0%}", f"of what it reports are labelled trees; {invented}")
        )
    entries += [
        (f"{found['ap']:.1f}", f"average precision of {kind}, of 100")
        for kind, found in figures["average_precision"].items()
        if found is not None
    ]
    if width is not None:
        entries.append((f"{width['mean_abs']:.1f} px", "mean error of the diameter"))
    return (
        f"<h1>{escape(title_of(figures))}</h1>"
        f'<p class="lead">Held against the labels of {data["frames"]:,} pictures in'
        f" {escape(str(data['folder']))}, {escape(data['split'])}.</p>" + tiles(entries)
    )


def _plain_words(figures: Figures) -> str:
    """For people who know trees rather than networks."""
    data, shown = figures["data"], figures["at_score"]
    reported = shown["found"] + shown["invented"]
    found = (
        f"The pictures hold {data['trees']:,} labelled trees. Of 100 of them the detector finds"
        f" {100 * shown['recall']:.0f}."
    )
    if shown["precision"] is not None:
        found += (
            f" Of 100 trees that it reports, {100 * shown['precision']:.0f} are labelled trees"
            f" ({reported:,} reported in all)."
        )
    texts = [found, " ".join(_keypoint_sentences(figures)), " ".join(_group_sentences(figures))]
    return "<h2>In plain words</h2>" + "".join(f"<p>{text}</p>" for text in texts if text)


def _keypoint_sentences(figures: Figures) -> Iterable[str]:
    keypoints, width = figures["keypoint_error_px"], figures["diameter_error_px"]
    cut = None if keypoints is None else keypoints["felling_cut"]
    if cut is not None and cut["distance"] is not None:
        yield (
            (
                "On half of the trees found, the point where the tree is to be cut lies within"
                f" {cut['distance']['median']:.1f} pixels of the right one"
            )
            + _by_direction(cut)
            + "."
        )
    if width is not None:
        way = "wide" if width["mean"] >= 0 else "narrow"
        yield (
            f"The stem's diameter is {width['mean_abs']:.1f} pixels off on average, and on the"
            f" whole {abs(width['mean']):.1f} too {way}."
        )
    if (cut is not None and cut["distance"] is not None) or width is not None:
        sizes = list(figures["data"]["picture_px"])
        yield f"The pictures have {' or '.join(map(escape, sizes[:3]))} pixels" + (
            " and other sizes." if len(sizes) > 3 else "."
        )


def _by_direction(cut: Figures) -> str:
    if cut["across"] is None:
        return ""
    return (
        f" ({cut['across']['median_abs']:.1f} across the stem,"
        f" {cut['along']['median_abs']:.1f} along it)"
    )


def _group_sentences(figures: Figures) -> Iterable[str]:
    """Where most is missed, of the axes that matter most."""
    for axis in list(figures["by"].values())[:_AXES_IN_WORDS]:
        groups = [group for group in axis["groups"] if group["trees"] >= _FEW_TREES]
        if len(groups) > 1:
            worst = min(groups, key=lambda group: group["recall"])
            best = max(groups, key=lambda group: group["recall"])
            if best["recall"] - worst["recall"] >= 0.1:
                yield (
                    f"By {escape(axis['title'].lower())}, most are found in"
                    f" “{escape(best['name'])}” ({100 * best['recall']:.0f} of 100) and fewest in"
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
        "COCO's average precision, 0 to 100: how few false alarms it costs to find how many trees,"
        " averaged over overlaps of 0.50 to 0.95 that count as found; AP50 and AP75 for an"
        " overlap of 0.50 and 0.75 alone. Small is a visible stem of less than 32² px, large one"
        " of more than 96² px. Keypoints overlap by their similarity, with sigmas of 0.25."
    )
    curves = [
        card(
            "The more it reports, the more of it is wrong",
            f'<div class="plot">{curves_svg(figures)}</div>',
            "From the surest detection on; an overlap of 0.50 counts as found.",
        )
    ]
    if figures["boxes_by_score"] is not None:
        curves.append(
            card(
                "What another score would show",
                f'<div class="plot">{scores_svg(figures)}</div>',
                "Boxes; 0.5 is the usual score from which detections are shown.",
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
        '<div class="card scroll"><table><thead><tr><th>point</th><th>trees</th>'
        "<th>median, px</th><th>mean, px</th><th>90 % within, px</th>"
        "<th>across: mean&nbsp;±&nbsp;σ</th><th>along: mean&nbsp;±&nbsp;σ</th>"
        "<th>horizontal: mean&nbsp;±&nbsp;σ</th><th>vertical: mean&nbsp;±&nbsp;σ</th></tr></thead>"
        f"<tbody>{rows}</tbody></table>"
        '<p class="note">Of trees found at a score of 0.5. Across the stem counts to the right,'
        " along it to the top, vertical downwards.</p></div>"
    )
    directions = card(
        "Horizontal and vertical errors, as in the paper’s figure 4",
        f'<div class="plot">{directions_svg(figures)}</div>',
    )
    stem = card(
        "Errors across and along the stem",
        f'<div class="plot">{stem_directions_svg(figures)}</div>',
        "An error across the stem leads the head past the tree, one along it makes the stump too"
        " high or too low.",
    )
    return f"<h2>Where the points lie</h2>{table}<br>{directions}<br>{stem}"


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
        f"Mean error {width['mean_abs']:.2f} px, half within {width['median_abs']:.2f} px, 90 %"
        f" within {width['p90_abs']:.2f} px; bias {width['mean']:+.2f} px, standard deviation"
        f" {width['sigma']:.2f} px; {width['count']:,} trees. The paper gives a mean error of 5.2"
        " px on its own data at 1280x720 px."
    )
    plots = f'<div class="plot">{diameters_svg(report.figures, errors)}</div>'
    return f"<h2>Diameters</h2>{card('Distance of the two diameter points', plots, note)}"


def _groups(figures: Figures) -> str:
    if not figures["by"]:
        return ""
    note = (
        "Trees of other groups count neither as found nor as missed. A false alarm belongs to no"
        " distance or species, so in such a table each one counts in every row: compare a row with"
        " the same row of another detector. Pale rows have fewer than 20 trees and say little."
    )
    tables = "<br>".join(_group_table(axis) for axis in figures["by"].values())
    return f'<h2>Under which conditions</h2><p class="note">{note}</p>{tables}'


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
    shown = galleries(report.measured)
    wide = " wide" if report.measured.store.spec.modality == "depth" else ""
    depth = " Left the colour picture, right the depth, near things bright." if wide else ""
    truth, found = (f"rgb({red}, {green}, {blue})" for blue, green, red in (TRUTH, FOUND))
    parts = [
        "<h2>Look at them</h2>"
        f'<p class="note"><span class="mark" style="color:{truth}"></span>the label, its points as'
        f' rings <span class="mark" style="color:{found}"></span>what the detector found, its'
        f" points as discs.{depth} Boxes of neighbours are drawn faintly.<br>{_point_legend()}</p>"
    ]
    for name, (title, note) in _GALLERIES.items():
        tiles_ = "".join(_exhibit(exhibit) for exhibit in shown[name]) or "<p>None.</p>"
        parts.append(
            f'<h3>{title}</h3><p class="note">{note}</p><div class="gallery{wide}">{tiles_}</div>'
        )
    return "".join(parts)


def _point_legend() -> str:
    """Every keypoint's colour and name."""
    return " ".join(
        f'<span class="dot" style="background:rgb({red}, {green}, {blue})"></span>'
        f"{name.replace('_', ' ')}"
        for name, (blue, green, red) in zip(KEYPOINT_NAMES, KEYPOINT_COLOURS, strict=True)
    )


def _exhibit(exhibit: Exhibit) -> str:
    data = base64.b64encode(exhibit.jpeg).decode("ascii")
    caption = escape(exhibit.caption)
    return (
        f'<figure><img src="data:image/jpeg;base64,{data}" width="{exhibit.width_px}"'
        f' height="{exhibit.height_px}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'
    )


def _method(figures: Figures) -> str:
    shown = figures["at_score"]
    notes = [*figures["data"]["notes"], *(f"left out: {line}" for line in figures["left_out"])]
    said = "".join(f"<li>{escape(line)}</li>" for line in notes)
    model = "".join(
        f"<tr><td>{escape(name.replace('_', ' '))}</td><td>{escape(str(value))}</td></tr>"
        for name, value in figures["model"].items()
        if value is not None
    )
    return (
        "<h2>How it was measured</h2>"
        f"<p>A tree counts as found if a detection with a score of at least {shown['score']}"
        f" overlaps its box by at least {shown['iou']} (intersection over union); each detection"
        " finds one tree. Average precision looks at all scores, and is counted by pycocotools."
        " The stem’s axis is that of the label, from the felling cut to the top point. Pixels are"
        " those of the pictures as they are on disk.</p>"
        + (f"<ul>{said}</ul>" if said else "")
        + f'<div class="card scroll"><h3>The model</h3><table class="words"><tbody>{model}'
        "</tbody></table></div>"
    )


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}"
