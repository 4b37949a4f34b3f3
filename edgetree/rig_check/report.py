"""The result of the checks of a rig as text for the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final

from basetree.counts import counted
from basetree.normal import NORMAL_975
from edgetree.rig_check.checks import HOLDS, RigCheck
from edgetree.rig_check.drive_check import RigReport

_NAME_WIDTH, _VALUE_WIDTH, _LIMIT_WIDTH = 34, 20, 16
# Names of checks, with names of --rig-errors and their unit in that of the check.
_ERRORS: Final = {
    "stems lean away from the camera": ("vertical", 1.0),
    "stems lean to the left": ("vertical", 1.0),
    "scale of the depth": ("scale", 0.01),
}
_DIGITS: Final = {"px": 1, "%": 1, "°": 1, "mm": 0, "ms": 0}


def report_lines(report: RigReport) -> Iterator[str]:
    """The lines of the report."""
    yield (
        f"{counted(report.frames, 'frame')} in {report.seconds:.0f} s, {report.used} searched:"
        f" {counted(report.silhouettes, 'point')} on silhouettes, {counted(report.stems, 'stem')}"
    )
    yield "each ± is half of a 95 % interval"
    for group, checks in groupby(report.checks, lambda check: check.group):
        yield ""
        yield group
        for check in checks:
            yield from _lines(check)
    if words := error_words(report.checks):
        yield ""
        yield f"for intervals that hold these errors: --rig-errors {words}"
    yield ""
    if report.passed:
        unknown = report.unknown
        but = f", but {len(unknown)} of {len(report.checks)} checks cannot tell" if unknown else ""
        yield f"result: passed{but}"
    for check in report.problems:
        yield f"result: failed: {problem_text(check)}: {check.reason}"


def error_words(checks: Sequence[RigCheck]) -> str:
    """The errors of the scale of depth and of the vertical that a drive shows, for --rig-errors.

    Each is the root mean square of what was found: its value, and its standard deviation.
    """
    found: dict[str, float] = {}
    for check in checks:
        name, share = _ERRORS.get(check.name, ("", 1.0))
        if name and check.value is not None and check.half_interval is not None:
            size = share * math.hypot(check.value, check.half_interval / NORMAL_975)
            found[name] = max(size, found.get(name, 0.0))
    return ",".join(f"{name}={size:.2g}" for name, size in found.items())


def problem_text(check: RigCheck) -> str:
    """A check that does not hold, in a few words."""
    return f"{check.name} is {_value(check)}, limit {_number(check.limit, check.unit)}"


def _lines(check: RigCheck) -> Iterator[str]:
    limit = "" if check.limit is None else f"limit {_number(check.limit, check.unit)}"
    verdict = "" if check.limit is None else check.verdict
    line = f"  {check.name:<{_NAME_WIDTH}}{_value(check):<{_VALUE_WIDTH}}"
    yield f"{line}{limit:<{_LIMIT_WIDTH}}{verdict}".rstrip()
    if check.verdict != HOLDS and check.reason:
        yield f"      {check.reason}"


def _value(check: RigCheck) -> str:
    if check.value is None:
        return "unknown"
    if check.half_interval is None:
        return _number(check.value, check.unit)
    digits = _digits(check)
    interval = f"{check.value:+.{digits}f} ± {check.half_interval:.{digits}f}"
    return interval + ("°" if check.unit == "°" else f" {check.unit}")


def _digits(check: RigCheck) -> int:
    """More digits where the limit is small."""
    small = check.limit is not None and check.limit < 1
    return 2 if small else _DIGITS[check.unit]


def _number(value: float | None, unit: str) -> str:
    text = f"{value:.2g}" if value is not None and value < 10 else f"{value:.0f}"
    return text + ("°" if unit == "°" else f" {unit}")
