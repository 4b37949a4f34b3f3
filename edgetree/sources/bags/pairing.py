"""Pair colour and depth pictures by their time stamps."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import median
from typing import Any, Final, NamedTuple

_CLOCK_JUMP_NS: Final = 1_000_000_000
_MAX_WAITING: Final = 30
_INTERVALS: Final = 15  # the period is their median


@dataclass(frozen=True, eq=False)
class Picture:
    """An image message.

    Attributes:
        stamp: Its time stamp, ns.
        log_ns: When it was recorded, ns.
        message: The message, whose picture is not decoded yet.
    """

    stamp: int
    log_ns: int
    message: Any


class Pair(NamedTuple):
    """Pictures of the same moment. One of them is None if the recording has only the other kind."""

    colour: Picture | None
    depth: Picture | None

    @property
    def leading(self) -> Picture:
        """The colour picture, or the depth picture if there is no colour."""
        picture = self.colour or self.depth
        assert picture is not None
        return picture

    @property
    def log_ns(self) -> int:
        """When the later of the two was recorded, ns."""
        return max(picture.log_ns for picture in self if picture is not None)


class StampCheck:
    """Check the order of the time stamps of one topic, and measure its period."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._intervals: deque[int] = deque(maxlen=_INTERVALS)

    @property
    def period_ns(self) -> int | None:
        """Median interval between the last stamps, ns; None before the second one."""
        return round(median(self._intervals)) if self._intervals else None

    def see(self, stamp: int) -> str:
        """Take a stamp: "good", "late" (not after the one before it), or "jump" (far back)."""
        last = self._last
        if last is not None and last - _CLOCK_JUMP_NS <= stamp <= last:
            return "late"
        self._last = stamp
        if last is None:
            return "good"
        if stamp < last:
            return "jump"
        self._intervals.append(stamp - last)
        return "good"


class Pairing:
    """Pair the pictures of two topics within half a period of the faster one.

    Pictures wait until a picture of the other topic shows whether a nearer one will come.

    Args:
        stamps: Checks of the stamps of "colour" and "depth", which know the periods.
        period_ns: Period of the faster topic, ns, until enough pictures tell it.
        counts: Where pictures that are left out are counted.
    """

    def __init__(
        self, stamps: Mapping[str, StampCheck], period_ns: int, counts: Counter[str]
    ) -> None:
        self._stamps, self._default_ns, self._counts = stamps, period_ns, counts
        self._waiting: dict[str, deque[Picture]] = {"colour": deque(), "depth": deque()}

    @property
    def tolerance_ns(self) -> int:
        """Largest difference of the stamps of a pair, ns."""
        periods = [check.period_ns for check in self._stamps.values()]
        known = [period for period in periods if period is not None]
        return (min(known) if len(known) == len(periods) else self._default_ns) // 2

    def add(self, role: str, picture: Picture, *, is_jump: bool = False) -> list[Pair]:
        """Take a picture; returns the pairs that are complete now.

        Args:
            role: "colour" or "depth".
            picture: The picture.
            is_jump: Whether its clock has jumped back, so that nothing before it is paired.
        """
        waiting = self._waiting[role]
        if is_jump:
            self._drop_all(role)
        waiting.append(picture)
        pairs = self._pairs(is_end=False)
        if len(waiting) > _MAX_WAITING:
            self._drop(role)
        return pairs

    def finish(self) -> list[Pair]:
        """The last pairs; what is left is counted."""
        pairs = self._pairs(is_end=True)
        for role in self._waiting:
            self._drop_all(role)
        return pairs

    def _pairs(self, *, is_end: bool) -> list[Pair]:
        pairs: list[Pair] = []
        colours, depths = self._waiting["colour"], self._waiting["depth"]
        while colours and depths:
            tolerance = self.tolerance_ns
            colour, depth = colours[0], depths[0]
            difference = depth.stamp - colour.stamp
            if abs(difference) > tolerance:
                self._drop("colour" if difference > 0 else "depth")
                continue
            earlier = depths if difference < 0 else colours
            if difference and len(earlier) == 1 and not is_end:
                break  # the next picture of the earlier topic may be nearer to the later one
            later = (colours if earlier is depths else depths)[0]
            if len(earlier) > 1 and abs(earlier[1].stamp - later.stamp) < abs(difference):
                self._drop("depth" if earlier is depths else "colour")
                continue
            pairs.append(Pair(colours.popleft(), depths.popleft()))
        return pairs

    def _drop(self, role: str) -> None:
        self._waiting[role].popleft()
        other = {"colour": "depth", "depth": "colour"}[role]
        self._counts[f"{role} without {other}"] += 1

    def _drop_all(self, role: str) -> None:
        while self._waiting[role]:
            self._drop(role)
