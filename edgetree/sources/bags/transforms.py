"""Transforms between coordinate frames over time, from the topics tf and tf_static."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from calib import RigidTransform
from edgetree.sources.bags.messages import frame_name, stamp_ns

# Frames that stay in place, best first: odom drifts but never jumps.
_FIXED: Final = ("odom", "map", "world")
_MAX_GAP_NS: Final = 1_000_000_000  # between two readings that are interpolated
_MAX_BEYOND_NS: Final = 100_000_000  # after the last or before the first reading
_CLOCK_JUMP_NS: Final = 1_000_000_000
_MAX_READINGS: Final = 2000
_MOST_M: Final = 1e8  # beyond the coordinates of all maps and the size of the Earth


@dataclass
class _Link:
    """Transforms from a frame to its parent: one for all times, or readings sorted by time."""

    parent: str
    is_static: bool
    stamps_ns: list[int] = field(default_factory=list)
    translations_m: list[NDArray[np.float64]] = field(default_factory=list)
    quaternions: list[NDArray[np.float64]] = field(default_factory=list)

    def add(
        self, stamp: int, translation_m: NDArray[np.float64], quaternion: NDArray[np.float64]
    ) -> None:
        jumps = self.stamps_ns and stamp < self.stamps_ns[-1] - _CLOCK_JUMP_NS
        if self.is_static or jumps:
            self._keep_from(len(self.stamps_ns))
        elif len(self.stamps_ns) > _MAX_READINGS:
            self._keep_from(_MAX_READINGS // 2)
        position = bisect_right(self.stamps_ns, stamp)
        self.stamps_ns.insert(position, stamp)
        self.translations_m.insert(position, translation_m)
        self.quaternions.insert(position, quaternion)

    def _keep_from(self, start: int) -> None:
        for values in (self.stamps_ns, self.translations_m, self.quaternions):
            del values[:start]

    def at(self, stamp: int) -> RigidTransform | None:
        """The transform at a time, interpolated between two readings; None in a gap."""
        after = bisect_right(self.stamps_ns, stamp)
        if self.is_static or after == 0 or after == len(self.stamps_ns):
            index = 0 if after == 0 else after - 1
            if not self.is_static and abs(self.stamps_ns[index] - stamp) > _MAX_BEYOND_NS:
                return None
            return _rigid(self.quaternions[index], self.translations_m[index])
        start, end = self.stamps_ns[after - 1], self.stamps_ns[after]
        if end - start > _MAX_GAP_NS:
            return None
        share = (stamp - start) / (end - start)
        first, second = self.quaternions[after - 1], self.quaternions[after]
        # The straight line between two quaternions: exact enough for the small turns in a gap.
        mixed = (1 - share) * first + share * (second if first @ second >= 0 else -second)
        place_m = (1 - share) * self.translations_m[after - 1]
        return _rigid(mixed, place_m + share * self.translations_m[after])


def _rigid(quaternion: NDArray[np.float64], place_m: NDArray[np.float64]) -> RigidTransform | None:
    length = np.linalg.norm(quaternion)
    if not length > 0:
        return None
    try:
        return RigidTransform.from_quaternion(quaternion / length, place_m)
    except InputError:
        return None


class TransformTree:
    """The transforms of a recording.

    Attributes:
        unusable: Number of transforms that were left out, as they are out of range or no rotation.
    """

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}
        self.unusable = 0

    def add(self, message: Any, *, is_static: bool, log_ns: int = 0) -> None:
        """Take a TFMessage; `log_ns` takes the place of stamps that are not set."""
        for entry in message.transforms:
            moved, turned = entry.transform.translation, entry.transform.rotation
            place_m = np.array([moved.x, moved.y, moved.z], np.float64)
            quaternion = np.array([turned.x, turned.y, turned.z, turned.w], np.float64)
            length = math.hypot(*quaternion)
            child, parent = frame_name(entry.child_frame_id), frame_name(entry.header.frame_id)
            is_rigid = bool((np.abs(place_m) <= _MOST_M).all()) and abs(length - 1) < 0.01
            if not is_rigid or child == parent:
                self.unusable += 1
                continue
            link = self._links.get(child)
            if link is None or link.parent != parent or link.is_static != is_static:
                link = self._links[child] = _Link(parent, is_static)
            link.add(stamp_ns(entry) or log_ns, place_m, quaternion / length)

    def fixed_frame(self, frame: str) -> str | None:
        """The best fixed frame that a frame is connected to; None if there is none."""
        chain = self._chain(frame)
        for wanted in _FIXED:
            for name in chain:
                if name.rpartition("/")[2] == wanted:
                    return name
        return None

    def is_complete(self, frame: str, stamp: int) -> bool:
        """Whether readings up to a time are there for all moving links above a frame."""
        links = [self._links[name] for name in self._chain(frame)[:-1]]
        return all(link.is_static or link.stamps_ns[-1] >= stamp for link in links)

    def lookup(self, source: str, target: str, stamp: int) -> RigidTransform | None:
        """The transform from one frame to another at a time; None if there is none."""
        up, down = self._chain(source), self._chain(target)
        common = next((name for name in up if name in down), None)
        if common is None:
            return None
        rise = self._along(up[: up.index(common)], stamp)
        fall = self._along(down[: down.index(common)], stamp)
        return None if rise is None or fall is None else rise.then(fall.inverse())

    def _chain(self, frame: str) -> list[str]:
        """The frame, its parent, and so on to the root."""
        chain = [frame]
        while chain[-1] in self._links:
            parent = self._links[chain[-1]].parent
            if parent in chain:  # a circle
                break
            chain.append(parent)
        return chain

    def _along(self, names: list[str], stamp: int) -> RigidTransform | None:
        """The transform from the first frame to the parent of the last one."""
        total = RigidTransform.identity()
        for name in names:
            step = self._links[name].at(stamp)
            if step is None:
                return None
            total = total.then(step)
        return total
