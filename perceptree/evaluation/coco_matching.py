"""A faster pycocotools evaluation that can ignore trees and reuse overlaps.

The results equal those of `pycocotools.cocoeval.COCOeval`.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from basetree.arrays import Float64
from perceptree.keypoints import KEYPOINT_NAMES

Kind = Literal["bbox", "segm", "keypoints"]
Near = list[tuple[int, list[tuple[int, float]]]]
"""(row, [(tree, overlap)]) of the detections that overlap a tree enough for any threshold."""

OKS_SIGMAS = (0.25,) * len(KEYPOINT_NAMES)
HALF, THREE_QUARTERS = 0, 5
"""Indices of 0.50 and 0.75 in COCO's thresholds 0.50, 0.55 ... 0.95."""


class Evaluation(COCOeval):  # type: ignore[misc]
    """A COCO evaluation of boxes, masks or keypoints.

    Attributes are those of `COCOeval`. OKS uses a sigma of 0.25 for every keypoint.
    """

    def __init__(
        self,
        truth: COCO,
        found: COCO,
        kind: Kind,
        sizes: Mapping[str, tuple[float, float]],
        ignored: Collection[int] = (),
        overlaps: Mapping[tuple[int, int], Any] | None = None,
    ) -> None:
        """Prepare an evaluation.

        Args:
            truth: Ground truth.
            found: Detections.
            kind: "bbox", "segm" or "keypoints".
            sizes: Names and limits of the area ranges in px².
            ignored: Annotation ids that count neither as found nor as missed.
            overlaps: Overlaps (`ious`) of an earlier evaluation of the same data.
        """
        super().__init__(truth, found, kind)
        self.params.areaRng = [list(limits) for limits in sizes.values()]
        self.params.areaRngLbl = list(sizes)
        if kind == "keypoints":
            self.params.kpt_oks_sigmas = np.array(OKS_SIGMAS)
        self._ignored = ignored
        self._known = overlaps

    def run(self) -> None:
        """Match and accumulate without printing."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.evaluate()
            self.accumulate()

    def figures(self, size: str) -> tuple[float, float, float] | None:
        """Return AP, AP50 and AP75 in percent for a size; None without a tree of that size."""
        precision = self.eval["precision"][:, :, 0, self.params.areaRngLbl.index(size), -1]
        values = 100 * precision.mean(axis=1)
        if values[HALF] < 0:
            return None
        return float(values.mean()), float(values[HALF]), float(values[THREE_QUARTERS])

    def _prepare(self) -> None:
        super()._prepare()
        of_masks = self.params.iouType == "segm"
        for trees in self._gts.values():
            for tree in trees:
                if tree["id"] in self._ignored or (of_masks and tree["unmasked"]):
                    tree["ignore"] = 1

    def computeIoU(self, image: int, category: int) -> Any:
        """Return the IoU of boxes or masks, (detections, trees)."""
        return self._overlaps(super().computeIoU, image, category)

    def computeOks(self, image: int, category: int) -> Any:
        """Return the object keypoint similarity, (detections, trees)."""
        return self._overlaps(super().computeOks, image, category)

    def _overlaps(self, compute: Any, image: int, category: int) -> Any:
        return compute(image, category) if self._known is None else self._known[image, category]

    def evaluateImg(
        self, image: int, category: int, limits: Sequence[float], most: int
    ) -> dict[str, Any] | None:
        """Match as pycocotools does, but try only pairs that overlap enough for any threshold."""
        trees, found = self._gts[image, category], self._dts[image, category]
        if not trees and not found:
            return None
        low, high = limits
        skipped = [int(t["ignore"] or not low <= t["area"] <= high) for t in trees]
        order = sorted(range(len(trees)), key=skipped.__getitem__)
        trees, ignored = [trees[index] for index in order], [skipped[index] for index in order]
        found = sorted(found, key=lambda one: -one["score"])[:most]
        near = _near(self.ious[image, category], order, self.params.iouThrs[0])
        crowds = [bool(tree["iscrowd"]) for tree in trees]
        shape = (len(self.params.iouThrs), len(found))
        matched = np.zeros(shape)
        ignored_rows = np.tile([not low <= one["area"] <= high for one in found], (shape[0], 1))
        for step, threshold in enumerate(self.params.iouThrs if near else ()):
            for row, tree in _match(near, threshold, ignored, crowds):
                matched[step, row] = trees[tree]["id"]
                ignored_rows[step, row] = ignored[tree]
        return {
            "dtMatches": matched,
            "dtScores": [one["score"] for one in found],
            "gtIgnore": np.array(ignored),
            "dtIgnore": ignored_rows.astype(bool),
        }


def _near(table: Any, order: list[int], lowest: float) -> Near:
    """Select the overlaps of at least `lowest`; trees are renumbered by `order`."""
    if not len(table):
        return []
    values: Float64 = np.asarray(table)[:, order]
    near: dict[int, list[tuple[int, float]]] = {}
    for row, tree in np.argwhere(values >= lowest).tolist():
        near.setdefault(row, []).append((tree, float(values[row, tree])))
    return list(near.items())


def _match(
    near: Near, threshold: float, ignored: list[int], crowds: list[bool]
) -> list[tuple[int, int]]:
    """Match detections to trees at one threshold, as COCO does.

    In order of falling score, each detection takes the free tree with the largest overlap; an
    ignored tree only if no other fits. Ignored trees come last; crowds are never used up.

    Returns:
        (row, tree) pairs.
    """
    least = min(threshold, 1 - 1e-10)
    pairs: list[tuple[int, int]] = []
    taken: set[int] = set()
    for row, overlaps in near:
        best, most = -1, least
        for tree, overlap in overlaps:
            if overlap < most or (tree in taken and not crowds[tree]):
                continue
            if best >= 0 and ignored[tree] and not ignored[best]:
                break
            best, most = tree, overlap
        if best >= 0:
            pairs.append((row, best))
            taken.add(best)
    return pairs
