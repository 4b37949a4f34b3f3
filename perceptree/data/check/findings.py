"""Problems found by the dataset check, counted by kind."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from perceptree.data.tally import LEFT_OUT

_MAX_NAMES = 5

# In the order of the report; each text follows a count.
KINDS = {
    "entry": "invalid entries in label files",
    **LEFT_OUT,
    "image_missing": "colour images missing",
    "image_broken": "colour images broken or truncated",
    "image_size": "colour images of another size than in the label file",
    "depth_missing": "depth images missing",
    "depth_broken": "depth images broken, truncated or not single-channel",
    "depth_size": "depth images of another size than in the label file",
    "box_outside": "boxes that extend more than 1 px outside their frame",
    "box_of_corners": "boxes that are x0, y0, x1, y1 of their masks: expected x, y, width, height",
    "mask_broken": "masks whose run lengths do not fill their frame",
    "mask_empty": "masks without pixels",
    "mask_outside_box": "masks that extend outside their box",
    "keypoint_outside": "keypoints outside their frame",
    "left_right_swapped": "trees with left and right diameter points swapped",
    "cut_above_middle": "trees with the felling cut above the middle of the axis",
    "middle_above_top": "trees with the middle of the axis above its top",
    "file_in_splits": "images in two splits",
    "scene_in_splits": "scenes in two splits",
    "picture_in_splits": "images nearly identical to an image of another split",
}


@dataclass(frozen=True)
class Finding:
    """One kind of problem.

    Attributes:
        kind: Key of `KINDS`.
        text: Description, to follow a count.
        count: How often it was found.
        first: Names of the first few occurrences.
    """

    kind: str
    text: str
    count: int
    first: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return asdict(self)

    def __str__(self) -> str:
        more = f", and {self.count - len(self.first)} more" if self.count > len(self.first) else ""
        return f"{self.count} {self.text}: {'; '.join(self.first)}{more}"


class Findings:
    """Counts problems by kind and keeps the first names of each."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._first: dict[str, list[str]] = {}

    def add(self, kind: str, name: str) -> None:
        """Record a problem of a kind in `KINDS`."""
        self._counts[kind] = self._counts.get(kind, 0) + 1
        first = self._first.setdefault(kind, [])
        if len(first) < _MAX_NAMES:
            first.append(name)

    def extend(self, faults: Iterable[tuple[str, str]]) -> None:
        """Record problems given as (kind, name)."""
        for kind, name in faults:
            self.add(kind, name)

    def listed(self) -> tuple[Finding, ...]:
        """Return the findings in the order of `KINDS`."""
        return tuple(
            Finding(kind, text, self._counts[kind], tuple(self._first[kind]))
            for kind, text in KINDS.items()
            if kind in self._counts
        )
