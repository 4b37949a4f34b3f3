"""Files of a check: the matched stems as CSV, plots, and the fitted settings."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from basetree.files.writing import replacing, text_file
from edgetree.check.acceptance import CheckResult
from edgetree.check.comparison import Comparison
from edgetree.check.error_fit import ErrorFit
from edgetree.check.matching import Pair
from edgetree.check.plot import draw_check
from edgetree.check.records import fit_record
from edgetree.check.stems import CHECKED
from edgetree.measure import Failure
from edgetree.results.csv_style import PLAIN, CsvStyle
from edgetree.results.pictures import encode_picture

TABLE_FILE: Final = "matched.csv"
SETTINGS_FILE: Final = "settings.json"


def check_files(folder: Path) -> list[Path]:
    """The files that `write_files` may write."""
    return [
        folder / name
        for name in (TABLE_FILE, SETTINGS_FILE, *(_plot_name(quantity) for quantity in CHECKED))
    ]


def write_files(folder: Path, result: CheckResult, style: CsvStyle = PLAIN) -> list[Path]:
    """Write the matched stems, a plot for each compared quantity, and the fitted settings.

    Args:
        folder: Where to.
        result: The check.
        style: How the table of matched stems is written.

    All files are written, or none. `settings.json` is written in every case; it has no settings if
    none were fitted. Plots of an earlier check that this one does not make are removed.

    Returns:
        The paths of the files.

    Raises:
        InputError: a file cannot be written.
    """
    settings = folder / SETTINGS_FILE
    with ExitStack() as stack:
        table = stack.enter_context(text_file(folder / TABLE_FILE))
        style.write_header(table, _COLUMNS)
        style.write_rows(table, _COLUMNS, (), map(_row, result.matching.pairs))
        stack.enter_context(text_file(settings)).write(_settings_text(result.fit))
        plots = [folder / _plot_name(quantity) for quantity in result.quantities]
        for path, check in zip(plots, result.quantities.values(), strict=True):
            file = stack.enter_context(replacing(path))
            file.write(encode_picture(draw_check(check), path.suffix))
    written = [folder / TABLE_FILE, *plots, settings]
    for path in check_files(folder):
        if path not in written and path.is_file():
            path.unlink()
    return written


def _plot_name(quantity: str) -> str:
    return f"{quantity.removesuffix('_m')}.png"


def _columns_of(quantity: str) -> tuple[str, ...]:
    name = quantity.removesuffix("_m")
    values = (f"{name}_{what}_m" for what in ("measured", "std", "caliper", "error"))
    return (*values, f"{name}_within95", f"{name}_failure")


_COLUMNS: Final = (
    "frame",
    "tree",
    "caliper_line",
    *(column for quantity in CHECKED for column in _columns_of(quantity)),
)


def _row(pair: Pair) -> dict[str, object]:
    row: dict[str, object] = {"frame": pair.measured.frame, "tree": pair.measured.tree}
    row["caliper_line"] = pair.caliper.line
    for quantity in CHECKED:
        caliper, measured = pair.caliper.values.get(quantity), pair.measured.values[quantity]
        cells: list[object] = [None] * len(_columns_of(quantity))
        if caliper is not None:
            cells[2] = caliper.value
        if isinstance(measured, Failure):
            cells[5] = measured.reason
        else:
            cells[:2] = measured
            if caliper is not None:
                each = Comparison(pair, measured, caliper)
                cells[3:5] = each.error.value, int(each.covered)
        row |= zip(_columns_of(quantity), cells, strict=True)
    return row


def _settings_text(fit: ErrorFit | Failure) -> str:
    """The fit as JSON; `settings` are arguments of `MeasureSettings`."""
    record: dict[str, object] = {"schema": "edgetree.check_settings/1"}
    if isinstance(fit, Failure):
        record |= {"settings": {}, "reason": fit.reason}
    else:
        record |= fit_record(fit)
    return json.dumps(record, indent=2, allow_nan=False) + "\n"
