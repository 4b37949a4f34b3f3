"""Which tree each detection means, at the score from which detections are shown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib import box_iou
from perceptree.data import FrameRecord
from perceptree.evaluation.predictions import FramePrediction

Float = NDArray[np.floating[Any]]

DISPLAY_SCORE = 0.5
MATCH_IOU = 0.5


class Pair(NamedTuple):
    """A tree and the detection that found it: frame, tree of the frame, row, overlap of boxes."""

    frame: int
    tree: int
    row: int
    iou: float


class Matches(NamedTuple):
    """What was found, missed as (frame, tree), and invented as (frame, row)."""

    found: list[Pair]
    missed: list[tuple[int, int]]
    invented: list[tuple[int, int]]

    @property
    def recall(self) -> float:
        """Share of the trees that were found; 0 without trees."""
        return len(self.found) / max(1, len(self.found) + len(self.missed))

    @property
    def precision(self) -> float | None:
        """Share of what was reported that is a tree; None where nothing was reported."""
        reported = len(self.found) + len(self.invented)
        return len(self.found) / reported if reported else None


def match_trees(frames: Sequence[FrameRecord], predictions: Sequence[FramePrediction]) -> Matches:
    """Pair detections of a score of at least 0.5 with trees, at an overlap of boxes of 0.5.

    By falling score each takes the tree that it overlaps most, of those not yet taken. What lies
    at least half within a crowd and is no tree's is neither found nor invented.
    """
    matches = Matches([], [], [])
    for number, (frame, found) in enumerate(zip(frames, predictions, strict=True)):
        _match_frame(number, frame, found, matches)
    return matches


def _match_frame(number: int, frame: FrameRecord, found: FramePrediction, matches: Matches) -> None:
    trees = [place for place, tree in enumerate(frame.trees) if not tree.crowd]
    crowds = [tree.box_px for tree in frame.trees if tree.crowd]
    boxes = np.array([frame.trees[place].box_px for place in trees]).reshape(-1, 4)
    free = np.ones(len(trees), bool)
    for row in _shown_rows(found):
        overlap = np.where(free, box_iou(found.boxes[row], boxes)[0], -1.0)
        best = int(overlap.argmax()) if len(trees) else -1
        if best >= 0 and overlap[best] >= MATCH_IOU:
            free[best] = False
            matches.found.append(Pair(number, trees[best], row, float(overlap[best])))
        elif not any(_share_within(found.boxes[row], crowd) >= MATCH_IOU for crowd in crowds):
            matches.invented.append((number, row))
    matches.missed.extend((number, trees[place]) for place in np.flatnonzero(free))


def _shown_rows(found: FramePrediction) -> Iterator[int]:
    """By falling score."""
    for row in np.argsort(-found.scores, kind="stable"):
        if found.scores[row] >= DISPLAY_SCORE:
            yield int(row)


def _share_within(box: Float, other: Float) -> float:
    """The part of a box that lies in another."""
    area = max(float((box[2:] - box[:2]).prod()), 1e-9)
    low, high = np.maximum(box[:2], other[:2]), np.minimum(box[2:], other[2:])
    return float(np.clip(high - low, 0, None).prod()) / area
