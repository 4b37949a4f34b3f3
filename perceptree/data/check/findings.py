"""What a check found: kinds, how often, and the first names of each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

_NAMED = 5

# In the order of the report: what is found, as it follows a count.
KINDS = {
    "entry": "wrong entries in label files, which would be refused",
    "image_missing": "colour pictures missing",
    "image_broken": "colour pictures broken or cut off",
    "image_size": "colour pictures of another size than their labels say",
    "depth_missing": "depth pictures missing",
    "depth_broken": "depth pictures broken, cut off or not of one channel",
    "depth_size": "depth pictures of another size than their labels say",
    "box_outside": "boxes that reach more than 1 px out of their frame",
    "mask_broken": "masks whose runs do not fill their frame",
    "mask_empty": "masks without a pixel",
    "mask_outside_box": "masks that reach out of their box",
    "keypoint_outside": "keypoints labelled outside their frame",
    "left_right_swapped": "trees with left and right diameter points swapped",
    "cut_above_middle": "trees with the felling cut above the middle of the axis",
    "middle_above_top": "trees with the middle of the axis above its top",
    "file_in_splits": "pictures that stand in two splits",
    "scene_in_splits": "scenes that stand in two splits",
    "picture_in_splits": "pictures that are nearly the same as one of another split",
}


@dataclass(frozen=True)
class Finding:
    """One kind of fault: what it is, how often it was found, and the first names."""

    kind: str
    text: str
    count: int
    first: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    def __str__(self) -> str:
        more = f", and {self.count - len(self.first)} more" if self.count > len(self.first) else ""
        return f"{self.count} {self.text}: {'; '.join(self.first)}{more}"


class Findings:
    """Counts faults by kind and keeps the first names of each."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._first: dict[str, list[str]] = {}

    def add(self, kind: str, name: str) -> None:
        """One more fault of a kind of `KINDS`."""
        self._counts[kind] = self._counts.get(kind, 0) + 1
        first = self._first.setdefault(kind, [])
        if len(first) < _NAMED:
            first.append(name)

    def extend(self, faults: Iterable[tuple[str, str]]) -> None:
        """More faults, as (kind, name)."""
        for kind, name in faults:
            self.add(kind, name)

    def listed(self) -> tuple[Finding, ...]:
        """What was found, in the order of `KINDS`."""
        return tuple(
            Finding(kind, text, self._counts[kind], tuple(self._first[kind]))
            for kind, text in KINDS.items()
            if kind in self._counts
        )
