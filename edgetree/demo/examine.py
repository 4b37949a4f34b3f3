"""Run a model on a frame with ground truth: detect, measure, compare and draw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edgetree.demo.comparison import FrameComparison, compare_trees
from edgetree.demo.matching import Match, match_boxes
from edgetree.demo.result import Picture
from edgetree.drawing.trees import draw_trees, picture_of_depth
from edgetree.frames.pipeline import image_for
from edgetree.measure import measure_trees
from edgetree.results.tree_labels import cut_marks, numbered, tree_labels
from edgetree.runtime.detector import TreeDetector
from edgetree.samples import SampleFrame

__all__ = ["examine"]

_JPEG_QUALITY: Final = 82


def examine(detector: TreeDetector, sample: SampleFrame) -> tuple[FrameComparison, Picture]:
    """Detect and measure the trees of one frame, compare them with the ground truth, draw them.

    The trees of the comparison are sorted from near to far. The picture shows their position in
    the comparison, counted from 1, or "?" for a detection that matches no labelled tree.
    """
    frame = sample.read()
    assert frame.depth_m is not None
    trees = detector.detect(image_for(detector, frame))
    measurements = measure_trees(trees, frame.depth_m, sample.camera, up_camera=sample.up_camera)
    truths = sorted(sample.trees, key=lambda tree: tree.distance_m)
    true_px = np.array([tree.box_px for tree in truths]).reshape(-1, 4)
    matches = match_boxes(trees.boxes_px, true_px)
    comparison = compare_trees(frame.name, truths, matches, trees.scores.tolist(), measurements)
    shown = picture_of_depth(frame.depth_m) if detector.manifest.takes_depth else frame.image
    assert shown is not None
    labels = numbered(tree_labels(trees, measurements), _numbers(len(trees), matches))
    drawn = draw_trees(shown, trees, labels, cuts=cut_marks(measurements, sample.camera))
    return comparison, _picture(frame.name, detector.manifest.modality, drawn)


def _numbers(detections: int, matches: Sequence[Match]) -> list[str]:
    """The number of each detection's tree in the tables, or "?"."""
    numbers = {match.detection: str(match.truth + 1) for match in matches}
    return [numbers.get(index, "?") for index in range(detections)]


def _picture(name: str, modality: str, drawn: NDArray[np.uint8]) -> Picture:
    data = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1].tobytes()
    return Picture(name, modality, data, drawn.shape[1], drawn.shape[0])
