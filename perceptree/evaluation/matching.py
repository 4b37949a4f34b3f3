"""Match detections to trees at the default score threshold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from basetree.arrays import Float
from calib import box_iou
from perceptree.data import FrameRecord
from perceptree.evaluation.predictions import FramePrediction

DISPLAY_SCORE = 0.5
MATCH_IOU = 0.5


class Pair(NamedTuple):
    """A tree and its detection.

    Attributes:
        frame: Index of the frame.
        tree: Index of the tree in the frame.
        row: Index of the detection in the frame.
        iou: Box IoU.
    """

    frame: int
    tree: int
    row: int
    iou: float


class Matches(NamedTuple):
    """Result of matching.

    Attributes:
        found: True positives.
        missed: False negatives as (frame, tree).
        invented: False positives as (frame, row).
    """

    found: list[Pair]
    missed: list[tuple[int, int]]
    invented: list[tuple[int, int]]

    @property
    def recall(self) -> float:
        """Share of the trees that were found; 0 without trees."""
        return len(self.found) / max(1, len(self.found) + len(self.missed))

    @property
    def precision(self) -> float | None:
        """Share of the detections that are trees; None without detections."""
        reported = len(self.found) + len(self.invented)
        return len(self.found) / reported if reported else None


def match_trees(
    frames: Sequence[FrameRecord],
    predictions: Sequence[FramePrediction],
    least_score: float = DISPLAY_SCORE,
) -> Matches:
    """Match detections to trees with a box IoU of at least 0.5.

    In order of falling score, each detection takes the unmatched tree with the largest IoU.
    Unmatched detections of which at least half lies inside an ignored tree or a crowd count
    neither way; those with a box IoU of at least 0.5 are among them.

    Args:
        frames: Labelled frames.
        predictions: Predictions of the frames.
        least_score: Detections with a lower score are left out.
    """
    matches = Matches([], [], [])
    for number, (frame, found) in enumerate(zip(frames, predictions, strict=True)):
        _match_frame(number, frame, found, least_score, matches)
    return matches


def _match_frame(
    number: int, frame: FrameRecord, found: FramePrediction, least_score: float, matches: Matches
) -> None:
    trees = [index for index, tree in enumerate(frame.trees) if not tree.ignored]
    ignored = [tree.box_px for tree in frame.trees if tree.ignored]
    boxes = np.array([frame.trees[index].box_px for index in trees]).reshape(-1, 4)
    free = np.ones(len(trees), bool)
    for row in _shown_rows(found, least_score):
        overlap = np.where(free, box_iou(found.boxes[row], boxes)[0], -1.0)
        best = int(overlap.argmax()) if len(trees) else -1
        if best >= 0 and overlap[best] >= MATCH_IOU:
            free[best] = False
            matches.found.append(Pair(number, trees[best], row, float(overlap[best])))
        elif not any(_share_within(found.boxes[row], box) >= MATCH_IOU for box in ignored):
            matches.invented.append((number, row))
    matches.missed.extend((number, trees[index]) for index in np.flatnonzero(free))


def _shown_rows(found: FramePrediction, least_score: float) -> Iterator[int]:
    """Yield the detections that reach a score by falling score."""
    for row in np.argsort(-found.scores, kind="stable"):
        if found.scores[row] >= least_score:
            yield int(row)


def _share_within(box: Float, other: Float) -> float:
    """The part of a box that lies in another."""
    area = max(float((box[2:] - box[:2]).prod()), 1e-9)
    low, high = np.maximum(box[:2], other[:2]), np.minimum(box[2:], other[2:])
    return float(np.clip(high - low, 0, None).prod()) / area
