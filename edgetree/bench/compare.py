"""Compare two results of `edgetree bench`: what became slower or less accurate than noise explains.

Rows of the two results belong together if model, precision, input size, provider, threads and batch
are the same. The time of a row is the median over its rounds. The noise of a row comes from the
range of the middle half of its rounds, so that one disturbed round does not count, and falls with
their number. A change counts if it exceeds the noise of both rows together, and `LEAST_SHARE` of
the time. Accuracy on the same frames has no noise.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any, Final

from basetree.errors import InputError
from edgetree.bench.noise import LEAST_SHARE, noise_of
from edgetree.bench.stored import StoredResult, StoredRow

LEAST_AP: Final = 0.1
"""Smallest loss of average precision that counts, in points."""

_CARD_DATE: Final = re.compile(r", \d{4}-\d\d-\d\d$")
_AVERAGE_PRECISIONS: Final = ("box_ap", "mask_ap", "keypoint_ap")


@dataclass(frozen=True)
class RowChange:
    """How one row of a result changed.

    Attributes:
        row: The row's key as text, such as "edge-n-depth int8 640x384 cpu, 2 threads, batch 1".
        old_ms: Median time of a frame before, over the rounds.
        new_ms: The same now.
        ratio: `new_ms` divided by `old_ms`.
        noise: Share by which the times of both results vary without a cause.
        lost_ap: Lost points of each average precision that fell by more than `LEAST_AP`.
        not_compared: Why the accuracy was not compared; empty if it was, or neither has one.
    """

    row: str
    old_ms: float
    new_ms: float
    ratio: float
    noise: float
    lost_ap: Mapping[str, float]
    not_compared: str = ""

    @property
    def slower(self) -> bool:
        """Whether the row became slower than the noise explains."""
        return self.ratio > 1.0 + self.noise

    @property
    def faster(self) -> bool:
        """Whether the row became faster than the noise explains."""
        return self.ratio < 1.0 / (1.0 + self.noise)

    @property
    def regressed(self) -> bool:
        """Whether the row became slower or less accurate."""
        return self.slower or bool(self.lost_ap)


@dataclass(frozen=True)
class ResultChange:
    """Two results of `edgetree bench` compared.

    Attributes:
        rows: The rows that both have, in the order of the new result.
        only_old: Rows of the old result alone.
        only_new: Rows of the new result alone.
        machines: The old and the new machine, if they differ; else None.
    """

    rows: tuple[RowChange, ...]
    only_old: tuple[str, ...]
    only_new: tuple[str, ...]
    machines: tuple[str, str] | None

    @property
    def regressions(self) -> tuple[RowChange, ...]:
        """The rows that became slower or less accurate."""
        return tuple(row for row in self.rows if row.regressed)

    def to_dict(self) -> dict[str, Any]:
        """The comparison as a JSON object."""
        rows = [{**asdict(row), "slower": row.slower, "faster": row.faster} for row in self.rows]
        return {
            "schema": "edgetree.bench-comparison/1",
            "rows": rows,
            "only_old": list(self.only_old),
            "only_new": list(self.only_new),
            "machines": None if self.machines is None else list(self.machines),
            "regressions": len(self.regressions),
        }

    def lines(self) -> Iterator[str]:
        """The comparison as lines of text."""
        if self.machines is not None:
            old, new = self.machines
            yield f"measured on different machines: {old}, then {new}"
        width = max((len(row.row) for row in self.rows), default=0)
        for row in self.rows:
            times = f"{row.old_ms:9.2f} ms {row.new_ms:9.2f} ms {100 * (row.ratio - 1):+7.1f} %"
            yield f"{row.row:{width}}  {times}  {_verdict(row)}"
        for text, names in (("only in OLD", self.only_old), ("only in NEW", self.only_new)):
            yield from (f"{name}: {text}" for name in names)


def compare_results(old: StoredResult, new: StoredResult) -> ResultChange:
    """Compare two results of `edgetree bench`.

    Args:
        old: The earlier result.
        new: The later one.

    Raises:
        InputError: The results have no row in common, or one has a row twice.
    """
    before, now = _by_key(old, "OLD"), _by_key(new, "NEW")
    common = [key for key in now if key in before]
    if not common:
        raise InputError(
            f"the results have no row in common ({', '.join(before)}; {', '.join(now)}): expected"
            " the same model, precision, size, provider, threads and batch in both"
        )
    machines = str(old.environment), str(new.environment)
    return ResultChange(
        rows=tuple(_change(key, before[key], now[key]) for key in common),
        only_old=tuple(key for key in before if key not in now),
        only_new=tuple(key for key in now if key not in before),
        machines=None if machines[0] == machines[1] else machines,
    )


def _by_key(result: StoredResult, name: str) -> dict[str, StoredRow]:
    rows = {row.key: row for row in result.rows}
    for key in rows:
        count = sum(row.key == key for row in result.rows)
        if count > 1:
            raise InputError(
                f"{name} has {count} rows of {key}: expected one of each model file and setting"
            )
    return rows


def _change(key: str, old: StoredRow, new: StoredRow) -> RowChange:
    old_ms, new_ms = _round_times(old), _round_times(new)
    was, now = median(old_ms), median(new_ms)
    noise = max(LEAST_SHARE, noise_of(old_ms) + noise_of(new_ms))
    accuracy = _lost(old, new), _not_compared(old, new)
    return RowChange(key, round(was, 3), round(now, 3), now / was, noise, *accuracy)


def _round_times(row: StoredRow) -> list[float]:
    return [each.p50_ms for each in row.rounds]


def _lost(old: StoredRow, new: StoredRow) -> dict[str, float]:
    """Points of average precision that were lost, where both were measured on the same frames."""
    if old.accuracy is None or new.accuracy is None or _not_compared(old, new):
        return {}
    found: dict[str, float] = {}
    for name in _AVERAGE_PRECISIONS:
        was, now = getattr(old.accuracy, name), getattr(new.accuracy, name)
        if was is not None and now is not None and (fall := round(was - now, 2)) > LEAST_AP:
            found[name] = fall
    return found


def _not_compared(old: StoredRow, new: StoredRow) -> str:
    if old.accuracy is None and new.accuracy is None:
        return ""
    measured = (old.accuracy, new.accuracy)
    # Results of older versions name the date of the card, too.
    was, now = (
        "not known" if each is None else f"of {_CARD_DATE.sub('', each.frames)}"
        for each in measured
    )
    return "" if was == now else f"{was}, then {now}"


def _verdict(row: RowChange) -> str:
    lost = "".join(f", {name} -{fall:.1f}" for name, fall in row.lost_ap.items())
    if row.not_compared:
        lost += f"; accuracy not compared: {row.not_compared}"
    noise = f"noise {100 * row.noise:.1f} %"
    if row.slower:
        return f"SLOWER ({noise}){lost}"
    return f"{'faster' if row.faster else 'no change'} ({noise}){lost}"
