"""COCO average precision of boxes, masks and keypoints, also for subsets of the trees."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pycocotools.coco import COCO

from perceptree.data import FrameRecord
from perceptree.evaluation.coco_matching import HALF, Evaluation, Kind
from perceptree.evaluation.predictions import FramePrediction
from perceptree.keypoints import KEYPOINT_NAMES

KINDS: tuple[Kind, ...] = ("bbox", "segm", "keypoints")
SIZES_PX2 = {
    "all": (0.0, 1e10),
    "small": (0.0, 32.0**2),
    "medium": (32.0**2, 96.0**2),
    "large": (96.0**2, 1e10),
}
"""COCO's size classes: area of the mask, or of the box without masks, in source px²."""

_THRESHOLDS = tuple(round(0.05 * step, 2) for step in range(1, 20))


@dataclass(frozen=True)
class Precision:
    """COCO average precision in percent.

    Attributes:
        ap: AP averaged over overlaps of 0.50 to 0.95.
        ap50: AP at an overlap of 0.50.
        ap75: AP at an overlap of 0.75.
        ap_small: AP of small trees; None if there are none.
        ap_medium: AP of medium trees; None if there are none.
        ap_large: AP of large trees; None if there are none.
    """

    ap: float
    ap50: float
    ap75: float
    ap_small: float | None = None
    ap_medium: float | None = None
    ap_large: float | None = None


class Scorer:
    """Average precision of the predictions of some frames, overall and for subsets."""

    def __init__(
        self, frames: Sequence[FrameRecord], predictions: Sequence[FramePrediction]
    ) -> None:
        self._frames = frames
        self._predictions = predictions
        self._truth = _ground_truth(frames)
        self._whole: dict[Kind, Evaluation] = {}

    def precision(self, kind: Kind) -> Precision | None:
        """Return the AP over all frames; None if model or labels lack this kind."""
        whole = self._evaluation(kind)
        every = None if whole is None else whole.figures("all")
        if whole is None or every is None:
            return None
        sizes = (whole.figures(size) for size in ("small", "medium", "large"))
        return Precision(*every, *(None if found is None else found[0] for found in sizes))

    def part(self, kind: Kind, trees: Collection[int], frames: Collection[int]) -> float | None:
        """Return the AP in percent of some trees in some frames.

        Other trees in these frames are ignored: they count neither as found nor as missed.
        Detections without a tree count as false positives in every subset, because they belong to
        no group of trees.

        Args:
            kind: "bbox", "segm" or "keypoints".
            trees: Indices among all trees.
            frames: Indices of the frames.
        """
        whole = self._evaluation(kind)
        if whole is None:
            return None
        ignored = set(range(1, 1 + self.trees)) - {tree + 1 for tree in trees}
        part = Evaluation(
            whole.cocoGt, whole.cocoDt, kind, {"all": SIZES_PX2["all"]}, ignored, whole.ious
        )
        part.params.imgIds = [self._frames[frame].image_id for frame in sorted(frames)]
        part.run()
        figures = part.figures("all")
        return None if figures is None else figures[0]

    def curve(self, kind: Kind) -> list[float] | None:
        """Return the precision at recalls 0, 0.01 ... 1 at an overlap of 0.50."""
        whole = self._evaluation(kind)
        if whole is None:
            return None
        values = whole.eval["precision"][HALF, :, 0, 0, -1]
        return None if (values < 0).any() else [float(value) for value in values]

    def by_score(self, kind: Kind) -> list[dict[str, float | None]] | None:
        """Return recall and precision at score thresholds 0.05, 0.10 ... 0.95.

        Shares 0 to 1 at an overlap of 0.50. Precision is None where nothing is detected.

        Returns:
            Rows with "score", "recall" and "precision"; None if model or labels lack this kind.
        """
        whole = self._evaluation(kind)
        if whole is None:
            return None
        frames = [frame for frame in whole.evalImgs[: len(self._frames)] if frame is not None]
        counted = [~frame["dtIgnore"][HALF] for frame in frames]
        trees = sum(int((frame["gtIgnore"] == 0).sum()) for frame in frames)
        if trees == 0:
            return None
        matched = [frame["dtMatches"][HALF] > 0 for frame in frames]
        right = np.concatenate([row[use] for row, use in zip(matched, counted, strict=True)])
        given = [np.array(frame["dtScores"]) for frame in frames]
        scores = np.concatenate([row[use] for row, use in zip(given, counted, strict=True)])
        rows: list[dict[str, float | None]] = []
        for threshold in _THRESHOLDS:
            shown = scores >= threshold
            found = int(right[shown].sum())
            precision = found / int(shown.sum()) if shown.any() else None
            rows.append({"score": threshold, "recall": found / trees, "precision": precision})
        return rows

    def overlap(self, kind: Kind, frame: int, tree: int, row: int) -> float | None:
        """Return the IoU, or keypoint similarity, of a detection and a tree of a frame.

        None without such a label, or for detections beyond COCO's limit per image.
        """
        whole, label = self._evaluation(kind), self._frames[frame].trees[tree]
        unknown = {"segm": not label.segmentation, "keypoints": not label.keypoints[:, 2].any()}
        if whole is None or unknown.get(kind):
            return None
        table = whole.ious[self._frames[frame].image_id, 1]
        order = np.argsort(-self._predictions[frame].scores, kind="stable")
        rank = int(np.flatnonzero(order == row)[0])
        return float(table[rank, tree]) if rank < len(table) else None

    @property
    def trees(self) -> int:
        """Number of labelled trees, ignored ones included."""
        return sum(len(frame.trees) for frame in self._frames)

    def _evaluation(self, kind: Kind) -> Evaluation | None:
        """Return the cached evaluation of all frames; None if model or labels lack this kind."""
        if kind not in self._whole:
            entries = _results(self._frames, self._predictions, kind)
            if entries is None:
                return None
            if kind == "segm" and not any(t.segmentation for f in self._frames for t in f.trees):
                return None
            truth = self._truth
            evaluation = Evaluation(truth, _loaded(truth, entries), kind, SIZES_PX2)
            evaluation.run()
            self._whole[kind] = evaluation
        return self._whole[kind]


def _ground_truth(frames: Sequence[FrameRecord]) -> COCO:
    annotations: list[dict[str, Any]] = []
    for frame in frames:
        for tree in frame.trees:
            x0, y0, x1, y1 = tree.box_px.tolist()
            masked = bool(tree.segmentation)
            outline = [[x0, y0, x1, y0, x1, y1, x0, y1]]
            area = float(frame.mask(tree).sum()) if masked else (x1 - x0) * (y1 - y0)
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": frame.image_id,
                    "category_id": 1,
                    "bbox": [x0, y0, x1 - x0, y1 - y0],
                    "area": area,
                    "iscrowd": int(tree.ignored),
                    "segmentation": tree.segmentation if masked else outline,
                    "unmasked": not masked,
                    "keypoints": tree.keypoints.ravel().tolist(),
                    "num_keypoints": int((tree.keypoints[:, 2] > 0).sum()),
                }
            )
    coco = COCO()
    coco.dataset = {
        "info": {},
        "images": [{"id": f.image_id, "width": f.width, "height": f.height} for f in frames],
        "annotations": annotations,
        "categories": [{"id": 1, "name": "tree", "keypoints": list(KEYPOINT_NAMES)}],
    }
    with contextlib.redirect_stdout(io.StringIO()):
        coco.createIndex()
    return coco


def _loaded(truth: COCO, entries: list[dict[str, Any]]) -> COCO:
    """Convert results to a COCO object; pycocotools cannot load an empty list."""
    with contextlib.redirect_stdout(io.StringIO()):
        if entries:
            return truth.loadRes(entries)
        nothing = COCO()
        nothing.dataset = {**truth.dataset, "annotations": []}
        nothing.createIndex()
    return nothing


def _results(
    frames: Sequence[FrameRecord], predictions: Sequence[FramePrediction], kind: Kind
) -> list[dict[str, Any]] | None:
    """Return COCO result entries; None if the model lacks the branch."""
    entries = []
    for frame, found in zip(frames, predictions, strict=True):
        if (kind == "segm" and found.masks is None) or (
            kind == "keypoints" and found.keypoints is None
        ):
            return None
        for row, (box, score) in enumerate(zip(found.boxes, found.scores, strict=True)):
            x0, y0, x1, y1 = box.tolist()
            entry: dict[str, Any] = {
                "image_id": frame.image_id,
                "category_id": 1,
                "score": float(score),
            }
            if kind == "segm" and found.masks is not None:
                entry["segmentation"] = dict(found.masks[row])
            elif kind == "keypoints" and found.keypoints is not None:
                entry["keypoints"] = found.keypoints[row].ravel().tolist()
            else:
                entry["bbox"] = [x0, y0, x1 - x0, y1 - y0]
            entries.append(entry)
    return entries
