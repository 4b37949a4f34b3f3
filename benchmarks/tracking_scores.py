"""IDF1 and HOTA of identities over frames, and ByteTrack as a baseline.

IDF1 after Ristani et al., "Performance measures and a data set for multi-target, multi-camera
tracking" (2016); HOTA after Luiten et al., "HOTA: a higher order metric for evaluating multi-object
tracking" (2021), averaged over box overlaps of 0.05 to 0.95. Needs scipy, ByteTrack needs
`supervision` before 0.27.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterable
from typing import Any

import numpy as np

from calib import box_iou
from edgetree import TreeDetections

# One frame: boxes (N, 4) and identities (N,) of the truth, and of the tracker.
ScoredFrame = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]

_IDF1_OVERLAP = 0.5
_HOTA_OVERLAPS = np.arange(0.05, 0.99, 0.05)


def scores(drives: Iterable[list[ScoredFrame]]) -> dict[str, float | int]:
    """IDF1, identity switches, HOTA and its parts, over all drives together."""
    frames = list(_numbered(drives))
    truths = sum(len(frame[1]) for frame in frames)
    found = sum(len(frame[3]) for frame in frames)
    overlaps = [box_iou(frame[0], frame[2]) for frame in frames]
    true_positive = _identity_matches(frames, overlaps)
    hota = np.mean([_hota(frames, overlaps, limit) for limit in _HOTA_OVERLAPS], axis=0)
    return {
        "idf1": round(2 * true_positive / max(truths + found, 1), 4),
        "id_precision": round(true_positive / max(found, 1), 4),
        "id_recall": round(true_positive / max(truths, 1), 4),
        "switches": _switches(frames, overlaps),
        "hota": round(float(hota[0]), 4),
        "detection_accuracy": round(float(hota[1]), 4),
        "association_accuracy": round(float(hota[2]), 4),
        "labels": truths,
        "boxes": found,
    }


def has_byte_track() -> bool:
    """Whether a `supervision` that has ByteTrack is installed."""
    if importlib.util.find_spec("supervision") is None:
        return False
    return hasattr(importlib.import_module("supervision"), "ByteTrack")


def byte_track(frames: list[TreeDetections], rate_hz: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Boxes and identities of each frame by ByteTrack with its default settings."""
    supervision: Any = importlib.import_module("supervision")
    tracker = supervision.ByteTrack(frame_rate=round(max(rate_hz, 1)))
    result = []
    for trees in frames:
        found = supervision.Detections(
            xyxy=trees.boxes_px.copy(),
            confidence=trees.scores.copy(),
            class_id=np.zeros(len(trees), int),
        )
        followed = tracker.update_with_detections(found)
        ids = followed.tracker_id if followed.tracker_id is not None else np.zeros(0, int)
        result.append((followed.xyxy.reshape(-1, 4), np.asarray(ids, int)))
    return result


def _numbered(drives: Iterable[list[ScoredFrame]]) -> Iterable[ScoredFrame]:
    """The frames of all drives, with identities that no two drives share."""
    truth_ids: dict[tuple[int, int], int] = {}
    found_ids: dict[tuple[int, int], int] = {}
    for number, frames in enumerate(drives):
        for boxes, ids, found, numbers in frames:
            yield (
                boxes,
                np.array([truth_ids.setdefault((number, i), len(truth_ids)) for i in ids], int),
                found,
                np.array([found_ids.setdefault((number, i), len(found_ids)) for i in numbers], int),
            )


def _assigned(gain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(gain, maximize=True)
    return rows, columns


def _identity_matches(frames: list[ScoredFrame], overlaps: list[np.ndarray]) -> int:
    """Boxes that agree under the best one-to-one matching of identities."""
    together = _together(frames, overlaps, _IDF1_OVERLAP)
    return int(together[_assigned(together)].sum())


def _together(frames: list[ScoredFrame], overlaps: list[np.ndarray], limit: float) -> np.ndarray:
    """(truths, found) number of frames in which both identities overlap."""
    shape = [max((int(f[k].max()) for f in frames if len(f[k])), default=-1) + 1 for k in (1, 3)]
    count = np.zeros(shape)
    for (_, ids, _, numbers), overlap in zip(frames, overlaps, strict=True):
        rows, columns = np.nonzero(overlap >= limit)
        count[ids[rows], numbers[columns]] += 1
    return count


def _switches(frames: list[ScoredFrame], overlaps: list[np.ndarray]) -> int:
    """Times that the number of a labelled stem differs from its last one."""
    last: dict[int, int] = {}
    switches = 0
    for (_, ids, _, numbers), overlap in zip(frames, overlaps, strict=True):
        rows, columns = _assigned(np.where(overlap >= _IDF1_OVERLAP, 1 + overlap, 0.0))
        for row, column in zip(rows, columns, strict=True):
            if overlap[row, column] >= _IDF1_OVERLAP:
                number = int(numbers[column])
                switches += last.get(int(ids[row]), number) != number
                last[int(ids[row])] = number
    return switches


def _hota(
    frames: list[ScoredFrame], overlaps: list[np.ndarray], limit: float
) -> tuple[float, float, float]:
    """HOTA, detection accuracy and association accuracy at one overlap."""
    together = _together(frames, overlaps, limit)
    truths, found = (np.zeros(size) for size in together.shape)
    for _, ids, _, numbers in frames:
        np.add.at(truths, ids, 1)
        np.add.at(found, numbers, 1)
    alike = together / np.maximum(truths[:, None] + found - together, 1)
    matches = np.zeros_like(together)
    for (_, ids, _, numbers), overlap in zip(frames, overlaps, strict=True):
        allowed = overlap >= limit
        gain = np.where(allowed, alike[np.ix_(ids, numbers)] + 1e-3 * overlap + 1e-9, 0.0)
        rows, columns = _assigned(gain)
        kept = allowed[rows, columns]
        np.add.at(matches, (ids[rows[kept]], numbers[columns[kept]]), 1)
    hits = matches.sum()
    accuracy = hits / max(truths.sum() + found.sum() - hits, 1)
    each = matches / np.maximum(truths[:, None] + found - matches, 1)
    association = (matches * each).sum() / max(hits, 1)
    return float(np.sqrt(accuracy * association)), float(accuracy), float(association)
