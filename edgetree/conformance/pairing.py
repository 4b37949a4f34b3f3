"""Which trees of a program are which of a kit's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from basetree.arrays import Float64
from basetree.matching import match_greedily
from calib import box_iou
from edgetree.conformance.results import FoundTree, FrameTrees

_MATCH_IOU: Final = 0.5


class Pairing:
    """Which trees of a program are which of the kit's, in one frame.

    The trees that the kit leaves out are candidates too. Where two trees cover each other and
    their scores hardly differ, either may be the one that is left out.

    Attributes:
        candidates: The kit's trees, then those that it leaves out.
        pairs: Indices of candidates and of the program's trees, each in one pair at most.
    """

    def __init__(
        self,
        wanted: FrameTrees,
        found: Sequence[FoundTree],
        score_threshold: float,
        score_tolerance: float,
    ) -> None:
        self._wanted, self._found = wanted, found
        self._certain_score = score_threshold + score_tolerance
        self._score_tolerance = score_tolerance
        self.candidates = (*wanted.trees, *(each.tree for each in wanted.covered))
        self.pairs = _match(self.candidates, found)

    def unmatched(self) -> Iterator[str]:
        """A line for each tree that is missing or too many."""
        rows, columns = {row for row, _ in self.pairs}, {column for _, column in self.pairs}
        name, trees = self._wanted.name, self._wanted.trees
        stand_ins = set()
        for row, column in self.pairs:
            if row < len(trees):
                continue
            by = self._wanted.covered[row - len(trees)].by
            near = trees[by].score - self.candidates[row].score <= 2 * self._score_tolerance
            if near and by not in rows:
                stand_ins.add(by)
            elif self._found[column].score >= self._certain_score:
                yield (
                    f"{name}: a tree too many ({_words(self._found[column])}), whose mask and that"
                    " of a better tree cover each other"
                )
        for index, tree in enumerate(trees):
            if index not in rows | stand_ins and tree.score >= self._certain_score:
                yield f"{name}: tree {index + 1} is missing ({_words(tree)})"
        for index, tree in enumerate(self._found):
            if index not in columns and tree.score >= self._certain_score:
                yield f"{name}: a tree too many ({_words(tree)})"


def _match(expected: Sequence[FoundTree], found: Sequence[FoundTree]) -> list[tuple[int, int]]:
    """Pairs of trees, those that overlap most first."""
    overlap = box_iou(_boxes(expected), _boxes(found))
    rows, columns = match_greedily(-overlap, overlap >= _MATCH_IOU)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def _boxes(trees: Sequence[FoundTree]) -> Float64:
    return np.array([tree.box_px for tree in trees], np.float64).reshape(-1, 4)


def _words(tree: FoundTree) -> str:
    box = ", ".join(f"{value:.0f}" for value in tree.box_px)
    return f"score {tree.score:.2f}, box {box}"
