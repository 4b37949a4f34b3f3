"""The tables of the report as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import NamedTuple

from edgetree.demo.comparison import QUANTITIES, TreeComparison
from edgetree.demo.result import ModelResult

__all__ = ["MODEL_LABELS", "QUANTITY_STYLES", "QuantityStyle", "frame_table", "model_table"]

MODEL_LABELS = {"depth": "Depth model", "rgb": "Colour model"}


class QuantityStyle(NamedTuple):
    """How to format a quantity.

    Attributes:
        name: name of the quantity.
        unit: unit of the text.
        per_metre: factor from metres to `unit`.
        digits: digits after the decimal point.
    """

    name: str
    unit: str
    per_metre: float
    digits: int

    def text(self, value_m: float) -> str:
        """The value in `unit`, without the unit's name."""
        return f"{value_m * self.per_metre:.{self.digits}f}"

    def std_text(self, std_m: float) -> str:
        """A standard deviation with ±; "± <0.01" instead of one that is rounded to zero."""
        least = 10.0**-self.digits
        if std_m * self.per_metre < least / 2:
            return f"± &lt;{least:.{self.digits}f}"
        return f"± {self.text(std_m)}"


QUANTITY_STYLES = {
    "distance_m": QuantityStyle("Distance", "m", 1.0, 2),
    "diameter_m": QuantityStyle("Diameter", "cm", 100.0, 1),
    "cut_height_m": QuantityStyle("Cut height", "cm", 100.0, 1),
}


def frame_table(models: Sequence[ModelResult], frame: int) -> str:
    """The table of a frame: a row per labelled tree, with true and measured values.

    Args:
        models: the results of the models.
        frame: index of the frame.
    """
    groups = "".join(
        f'<th class="group" colspan="{1 + len(models)}">{style.name}, {style.unit}</th>'
        for style in QUANTITY_STYLES.values()
    )
    heads = '<th class="group">true</th>' + "".join(
        f'<th class="{_colour(index)}">{MODEL_LABELS[model.modality].lower()}</th>'
        for index, model in enumerate(models)
    )
    rows = []
    for number, trees in enumerate(
        zip(*(model.frames[frame].trees for model in models), strict=True), start=1
    ):
        cells = "".join(_quantity_cells(trees, quantity) for quantity in QUANTITY_STYLES)
        rows.append(f"<tr><td>{number}</td>{cells}</tr>")
    return (
        '<div class="scroll"><table><thead>'
        f'<tr><th rowspan="2">tree</th>{groups}</tr><tr>{heads * len(QUANTITY_STYLES)}</tr>'
        f"</thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


def _quantity_cells(trees: Sequence[TreeComparison], quantity: str) -> str:
    """The cells of one quantity of one tree: the true value, then each model's."""
    style = QUANTITY_STYLES[quantity]
    true_text = style.text(getattr(trees[0].truth, quantity))
    return f'<td class="truth group">{true_text}</td>' + "".join(
        _measured_cell(tree, quantity, style) for tree in trees
    )


def _measured_cell(tree: TreeComparison, quantity: str, style: QuantityStyle) -> str:
    estimate = tree.estimate(quantity)
    if estimate is not None:
        value, std = style.text(estimate.value), style.std_text(estimate.std)
        if tree.is_gross(quantity):
            return f'<td class="gross">{value} <small>{std}</small> gross error</td>'
        return f"<td>{value} <small>{std}</small></td>"
    reason = tree.failure(quantity) if tree.found else "not found"
    return f'<td class="why">{escape(reason or "")}</td>'


def model_table(models: Sequence[ModelResult]) -> str:
    """The table of the models: file, speed and errors, one column per model."""
    rows: list[tuple[str, list[str]]] = [
        ("file", [f"{m.name}, {m.precision}, {m.file_bytes / 1e6:.1f} MB" for m in models]),
        ("input", [f"{m.input_width_px} × {m.input_height_px} px" for m in models]),
        ("processor threads", [str(m.speed.threads) for m in models]),
        (
            "time per frame, median / 90th percentile",
            [f"{m.speed.p50_ms:.1f} / {m.speed.p90_ms:.1f} ms" for m in models],
        ),
        (
            "frames per second, at the median / 90th percentile",
            [f"{m.speed.fps:.1f} / {m.speed.fps_at_p90:.1f}" for m in models],
        ),
        ("labelled trees found", [f"{m.found_trees} of {m.true_trees}" for m in models]),
        (
            "detections that match no labelled tree",
            [str(m.unmatched_detections) for m in models],
        ),
    ]
    for quantity in QUANTITIES:
        style = QUANTITY_STYLES[quantity]
        rows.append((f"{style.name.lower()}: measured", [_count(m, quantity) for m in models]))
        rows.append((f"{style.name.lower()}: median error", [_error(m, quantity) for m in models]))
        rows.append(
            (f"{style.name.lower()}: gross errors", [str(m.gross_errors(quantity)) for m in models])
        )
        rows.append(
            (f"{style.name.lower()}: within 1 / 2 std", [_coverage(m, quantity) for m in models])
        )
    heads = "".join(
        f'<th class="{_colour(index)}">{MODEL_LABELS[model.modality]}</th>'
        for index, model in enumerate(models)
    )
    body = "".join(
        f"<tr><td>{name}</td>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
        for name, cells in rows
    )
    return (
        f'<div class="scroll"><table class="text"><thead><tr><th></th>{heads}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _count(model: ModelResult, quantity: str) -> str:
    return f"{model.summary(quantity).measured} trees"


def _error(model: ModelResult, quantity: str) -> str:
    summary = model.summary(quantity)
    if summary.median_abs_error_m is None:
        return "–"
    style = QUANTITY_STYLES[quantity]
    relative = summary.median_relative_error
    share = "" if relative is None else f" ({relative:.{0 if relative >= 0.01 else 1}%})"
    return f"{style.text(summary.median_abs_error_m)} {style.unit}{share}"


def _coverage(model: ModelResult, quantity: str) -> str:
    summary = model.summary(quantity)
    if summary.within_one_std is None or summary.within_two_std is None:
        return "–"
    return f"{summary.within_one_std:.0%} / {summary.within_two_std:.0%}"


def _colour(index: int) -> str:
    """The CSS class of a model's colour."""
    return "first" if index == 0 else "second"
