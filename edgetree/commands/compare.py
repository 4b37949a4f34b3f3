"""`edgetree compare`: compare two results of `edgetree bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from basetree.counts import counted
from basetree.program.console import print_found
from edgetree.commands.options import Json

_Old: TypeAlias = Annotated[
    Path, typer.Argument(metavar="OLD.json", help="Earlier result of `edgetree bench --out`.")
]
_New: TypeAlias = Annotated[Path, typer.Argument(metavar="NEW.json", help="Later result.")]


def compare(old: _Old, new: _New, as_json: Json = False) -> None:
    """Compare two results of `edgetree bench`: is the new one slower or less accurate?

    A change of a time counts if it exceeds the noise of both results and 3 percent; a loss of
    average precision on the same frames counts from 0.1 points on.

    The exit code is 1 if a model became slower or less accurate.
    """
    from basetree.errors import CheckFailed
    from edgetree.bench.compare import compare_results
    from edgetree.bench.stored import read_result

    found = compare_results(read_result(old), read_result(new))
    print_found(as_json, found.to_dict, found.lines)
    if found.regressions:
        raise CheckFailed(
            f"{len(found.regressions)} of {counted(len(found.rows), 'row')} became worse"
        )
