"""The options about how CSV tables are written."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from edgetree.commands.options import RESULTS

if TYPE_CHECKING:
    from edgetree.results.csv_style import CsvStyle


@dataclass(frozen=True)
class CsvOptions:
    """How CSV tables are written."""

    panel = RESULTS

    csv_style: Annotated[
        str,
        typer.Option(
            metavar="plain|excel",
            help="How CSV files are written: for programs; or a short table for Excel and other"
            " spreadsheets in countries with decimal commas, separated by semicolons, with figures"
            " rounded to what their errors carry.",
        ),
    ] = "plain"
    all_columns: Annotated[
        bool, typer.Option("--all-columns", help="All columns with --csv-style excel, too.")
    ] = False

    def style(self, *paths: Path | None) -> CsvStyle:
        """The style.

        Args:
            paths: The CSV files that the command is to write, None for those that it is not.

        Raises:
            InputError: A style is given without a file, or its name is unknown.
        """
        from basetree.errors import InputError
        from edgetree.results.csv_style import EXCEL, PLAIN

        styles = {"plain": PLAIN, "excel": EXCEL}
        if self.csv_style not in styles:
            raise InputError(f"--csv-style is {self.csv_style!r}: expected {' or '.join(styles)}")
        style = styles[self.csv_style]
        if style != PLAIN and not any(paths):
            raise InputError("--csv-style given without a CSV file to write: expected both")
        if self.all_columns and style == PLAIN:
            raise InputError("--all-columns given without --csv-style excel: expected both")
        return replace(style, all_columns=True) if self.all_columns else style

    def check_plain(self) -> None:
        """Raise InputError if the tables are to be merged from parts, which are written plain."""
        from basetree.errors import InputError

        if self != CsvOptions():
            raise InputError("--csv-style given with --shards: expected tables for programs alone")
