"""Run a model on a frame with ground truth: detect, measure, compare and draw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edgetree.demo.comparison import FrameComparison, compare_trees
from edgetree.demo.matching import Match, match_boxes
from edgetree.demo.result import Picture
from edgetree.drawing.trees import draw_trees, picture_of_depth
from edgetree.measure import measure_trees
from edgetree.results.tree_labels import cut_marks, numbered, tree_labels
from edgetree.runtime.detector import TreeDetector
from edgetree.samples import SampleFrame

__all__ = ["examine", "seen_by"]

_JPEG_QUALITY: Final = 82


def seen_by(detector: TreeDetector, frame: SampleFrame) -> NDArray[Any]:
    """The image that the model takes: colour (H, W, 3) uint8 BGR, or depth (H, W) in metres."""
    return frame.depth_m() if detector.manifest.modality == "depth" else frame.image()


def examine(detector: TreeDetector, frame: SampleFrame) -> tuple[FrameComparison, Picture]:
    """Detect and measure the trees of one frame, compare them with the ground truth, draw them.

    The trees of the comparison are sorted from near to far. The picture shows their position in
    the comparison, counted from 1, or "?" for a detection that matches no labelled tree.
    """
    depth_m = frame.depth_m()
    trees = detector.detect(seen_by(detector, frame))
    measurements = measure_trees(trees, depth_m, frame.camera, up_camera=frame.up_camera)
    truths = sorted(frame.trees, key=lambda tree: tree.distance_m)
    true_px = np.array([tree.box_px for tree in truths]).reshape(-1, 4)
    matches = match_boxes(trees.boxes_px, true_px)
    comparison = compare_trees(frame.name, truths, matches, trees.scores.tolist(), measurements)
    is_depth = detector.manifest.modality == "depth"
    base = picture_of_depth(depth_m) if is_depth else frame.image()
    labels = numbered(tree_labels(trees, measurements), _numbers(len(trees), matches))
    drawn = draw_trees(base, trees, labels, cuts=cut_marks(measurements, frame.camera))
    return comparison, _picture(frame.name, detector.manifest.modality, drawn)


def _numbers(detections: int, matches: Sequence[Match]) -> list[str]:
    """The number of each detection's tree in the tables, or "?"."""
    numbers = {match.detection: str(match.truth + 1) for match in matches}
    return [numbers.get(index, "?") for index in range(detections)]


def _picture(name: str, modality: str, drawn: NDArray[np.uint8]) -> Picture:
    data = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1].tobytes()
    return Picture(name, modality, data, drawn.shape[1], drawn.shape[0])
