"""The tables of the report as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from typing import Final

from basetree.page import parts
from edgetree.demo.comparison import QUANTITIES, TreeComparison, is_gross
from edgetree.demo.result import ModelResult
from edgetree.results.units import AMOUNTS

SHOWN: Final = {
    "distance_m": AMOUNTS["distance_m"],
    "diameter_m": AMOUNTS["diameter_m"],
    "cut_height_m": AMOUNTS["cut_height_m"]._replace(digits=1),
}
"""The compared quantities in the report's order, and how to format them."""

_COLOURS: Final = ("first", "second")


def _text(quantity: str, value_m: float) -> str:
    """A value without its unit."""
    amount = SHOWN[quantity]
    return f"{value_m * amount.per_unit:.{amount.digits}f}"


def error_text(model: ModelResult, quantity: str) -> str:
    """The median error with its unit, or a dash."""
    error_m = model.summary(quantity).median_abs_error_m
    return "–" if error_m is None else f"{_text(quantity, error_m)} {SHOWN[quantity].unit}"


def frame_table(models: Sequence[ModelResult], frame: int) -> str:
    """The table of a frame: a row per labelled tree, with true and measured values.

    Args:
        models: The results of the models.
        frame: Index of the frame.
    """
    columns = f'class="group" colspan="{1 + len(models)}"'
    groups = [
        parts.Cell("tree", 'rowspan="2"'),
        *(parts.Cell(f"{each.name.capitalize()}, {each.unit}", columns) for each in SHOWN.values()),
    ]
    heads = [
        parts.Cell("true", 'class="group"'),
        *(parts.Cell(model.label, f'class="{_COLOURS[n]}"') for n, model in enumerate(models)),
    ]
    rows: Iterable[parts.Cells] = (
        [str(trees[0].number), *(cell for name in SHOWN for cell in _cells(trees, name))]
        for trees in zip(*(model.frames[frame].trees for model in models), strict=True)
    )
    return parts.table(heads * len(SHOWN), rows, groups=groups)


def _cells(trees: Sequence[TreeComparison], quantity: str) -> Iterator[parts.Cell]:
    """The cells of one quantity of one tree: the true value, then each model's."""
    yield parts.Cell(_text(quantity, getattr(trees[0].truth, quantity)), 'class="truth group"')
    for tree in trees:
        found = tree.compared(quantity)
        if found is None:
            yield parts.Cell(escape(tree.missing(quantity)), 'class="why"')
            continue
        value, std = _text(quantity, found.measured.value), _std_text(quantity, found.measured.std)
        if is_gross(quantity, found):
            yield parts.Cell(f"{value} <small>{std}</small> gross error", 'class="gross"')
        else:
            yield parts.Cell(f"{value} <small>{std}</small>")


def _std_text(quantity: str, std_m: float) -> str:
    """A standard deviation with ±; "± <0.01" instead of one that is rounded to zero."""
    amount = SHOWN[quantity]
    least = 10.0**-amount.digits
    if std_m * amount.per_unit < least / 2:
        return f"± &lt;{least:.{amount.digits}f}"
    return f"± {_text(quantity, std_m)}"


def model_table(models: Sequence[ModelResult]) -> str:
    """The table of the models: file, speed and errors, one column per model."""
    heads = [
        parts.Cell(model.label.capitalize(), f'class="{_COLOURS[n]}"')
        for n, model in enumerate(models)
    ]
    columns = [_model_rows(model) for model in models]
    rows = ([name, *(column[name] for column in columns)] for name in columns[0])
    return parts.table(["", *heads], rows, kind="text")


def _model_rows(model: ModelResult) -> dict[str, str]:
    """What the table says about a model, by row."""
    manifest, speed = model.manifest, model.speed
    times = f"{speed.detect_p50_ms:.1f} / {speed.detect_p90_ms:.1f} ms"
    fps = f"{model.fps:.1f} / {model.fps_at_p90:.1f}"
    rows = {
        "file": f"{manifest.name}, {manifest.precision}, {model.file_bytes / 1e6:.1f} MB",
        "input": f"{manifest.input.width} × {manifest.input.height} px",
        "processor threads": str(speed.threads),
        "time per frame, median / 90th percentile": times,
        "frames per second, at the median / 90th percentile": fps,
        "labelled trees found": f"{model.found_trees} of {model.true_trees}",
        "detections that match no labelled tree": str(model.unmatched_detections),
    }
    for quantity in QUANTITIES:
        name = SHOWN[quantity].name
        measured, _, relative, *within = model.summary(quantity)
        share = "" if relative is None else f" ({relative:.{0 if relative >= 0.01 else 1}%})"
        rows[f"{name}: measured"] = f"{measured} trees"
        rows[f"{name}: median error"] = error_text(model, quantity) + share
        rows[f"{name}: gross errors"] = str(model.gross_errors(quantity))
        rows[f"{name}: within 1 / 2 std"] = (
            " / ".join(f"{each:.0%}" for each in within if each is not None) or "–"
        )
    return rows
