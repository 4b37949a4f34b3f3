"""`edgetree check`: compare measured stems with a caliper's readings."""

from __future__ import annotations

import math
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from basetree.program.console import note, print_found
from basetree.program.options import expand_groups
from basetree.program.quoting import quoted
from edgetree.commands.csv_options import CsvOptions
from edgetree.commands.options import Json

_Measured: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="MEASURED.csv", help="Table of `edgetree run --csv` or `measure --csv`."
    ),
]
_Caliper: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="CALIPER.csv",
        help="Table with a header and one row per stem: tree (its number in MEASURED.csv) or x_m,"
        " y_m, z_m (its position); frame, if MEASURED.csv has several; diameter_cm, dbh_cm or both"
        " (or _mm, _m, _in); cut_height_cm if measured. Comma, semicolon and decimal comma are"
        " understood.",
    ),
]
_Out: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Folder for plots, the table of matched stems and the fitted settings."),
]
_MaxDistance: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="Largest distance between two positions of one stem, metres. Only for tables that are"
        " matched by position.",
        show_default="0.5",
    ),
]


@expand_groups
def check(
    measured: _Measured,
    caliper: _Caliper,
    out: _Out = None,
    max_distance: _MaxDistance = None,
    *,
    csv_options: CsvOptions,
    as_json: Json = False,
) -> None:
    """Compare measured stems with a caliper's: an acceptance test for a machine.

    Prints the bias, the scatter and how many of the 95 % intervals hold the caliper's value. From
    20 stems on, the stated errors are fitted to the machine.

    The exit code is 0 if the machine passes, 1 if it fails, and 3 if it cannot be judged: the
    stems are too few, or several readings of the caliper look wrong.
    """
    from basetree.errors import CheckFailed, CheckUndecided, InputError
    from basetree.files.places import check_paths
    from basetree.files.writing import output_folder
    from edgetree.check import compare, read_caliper, read_measured
    from edgetree.check.acceptance import MAX_DISTANCE_M
    from edgetree.check.files import check_files, write_files
    from edgetree.check.report import report_lines

    if max_distance is not None and not (math.isfinite(max_distance) and max_distance > 0):
        raise InputError(f"--max-distance is {max_distance}: expected metres above 0")
    style = csv_options.style(out)
    files = [] if out is None else check_files(out)
    check_paths(
        {f"{path.name} of --out": path for path in files},
        {"MEASURED.csv": measured, "CALIPER.csv": caliper},
    )
    result = compare(
        read_measured(measured),
        read_caliper(caliper),
        max_distance_m=MAX_DISTANCE_M if max_distance is None else max_distance,
    )
    if max_distance is not None and result.matching.by == "number":
        raise InputError(
            f"--max-distance is {max_distance:g}: {caliper} numbers its stems in the column tree,"
            " and these are matched by number; expected a table without that column, or the command"
            " without --max-distance"
        )
    with ExitStack() as stack:
        folder = None if out is None else stack.enter_context(output_folder(out))
        written = [] if folder is None else write_files(folder, result, style)
    record = {
        "schema": "edgetree.check/1",
        "measured": str(measured),
        "caliper": str(caliper),
        **result.to_dict(),
        "files": [str(path) for path in written],
    }
    print_found(as_json, lambda: record, lambda: report_lines(result))
    for path in written:
        note(f"written: {path}")
    if out is None:
        note(f"next: edgetree check {quoted(measured)} {quoted(caliper)} --out check", whole=True)
    # A terminal shows the reasons just above.
    is_seen = not as_json and sys.stdout.isatty()
    reasons = "see above" if is_seen else "; ".join(result.verdict.reasons)
    if result.verdict.outcome == "failed":
        raise CheckFailed(f"{measured}: the check failed: {reasons}")
    if result.verdict.outcome == "undecided":
        far = "" if result.verdict.doubts else ", nothing wrong was found so far"
        raise CheckUndecided(f"{measured}: the check is undecided{far}: {reasons}")
