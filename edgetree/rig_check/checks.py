"""A check of a rig: a value with its interval, the limit, and whether it holds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

from basetree.normal import NORMAL_975
from edgetree.measure import Estimate

Verdict: TypeAlias = Literal["holds", "does not hold", "cannot tell"]

HOLDS: Final = "holds"
NO: Final = "does not hold"
UNKNOWN: Final = "cannot tell"


@dataclass(frozen=True)
class RigCheck:
    """One check.

    Attributes:
        name: What is checked, such as "shift to the right".
        group: The part of the report that it belongs to.
        verdict: Whether the value is within the limit.
        limit: Largest size of the value; None if there is none.
        unit: Unit of the value, such as "px".
        value: The measured value; None if it is not known.
        half_interval: Half of the 95 % interval; None for counts.
        reason: What is missing or what to do, if the check does not hold or cannot tell.
    """

    name: str
    group: str
    verdict: Verdict
    limit: float | None
    unit: str
    value: float | None = None
    half_interval: float | None = None
    reason: str = ""

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary."""
        return {
            "check": self.name,
            "group": self.group,
            "verdict": self.verdict,
            "value": self.value,
            "half_interval95": self.half_interval,
            "limit": self.limit,
            "unit": self.unit,
            "reason": self.reason,
        }


def judged(
    name: str,
    group: str,
    estimate: Estimate | str,
    limit: float,
    unit: str,
    remedy: str,
    need: str,
) -> RigCheck:
    """Compare the size of an estimate with its limit.

    It holds if the whole 95 % interval is within the limit, and does not hold if all of it is
    beyond. Otherwise, nothing can be told.

    Args:
        name, group, unit: As in `RigCheck`.
        estimate: The estimate, or why there is none.
        limit: Largest size of the value.
        remedy: What to do if it does not hold.
        need: What makes the interval narrower.
    """
    if isinstance(estimate, str):
        return RigCheck(name, group, UNKNOWN, limit, unit, reason=estimate)
    half = NORMAL_975 * estimate.std
    if not math.isfinite(half):
        return RigCheck(
            name, group, UNKNOWN, limit, unit, reason=f"the frames do not show it: {need}"
        )
    verdict: Verdict
    size = abs(estimate.value)
    if size + half <= limit:
        verdict, reason = HOLDS, ""
    elif size - half > limit:
        verdict, reason = NO, remedy
    else:
        verdict, reason = UNKNOWN, f"the interval is too wide: {need}"
    return RigCheck(name, group, verdict, limit, unit, estimate.value, half, reason)
