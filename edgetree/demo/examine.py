"""Run a model on a frame with ground truth: detect, measure, compare and draw."""

from __future__ import annotations

import numpy as np

from basetree.page.parts import jpeg_of
from edgetree.demo.comparison import FrameComparison, compare_trees
from edgetree.demo.matching import match_boxes
from edgetree.drawing.trees import draw_trees, picture_of_depth
from edgetree.frames.pipeline import process
from edgetree.frames.rig import Rig
from edgetree.measure import EXACT_RIG
from edgetree.results.tree_labels import cut_marks, numbered, tree_labels
from edgetree.runtime.detector import TreeDetector
from edgetree.samples import SampleFrame


def examine(detector: TreeDetector, sample: SampleFrame) -> FrameComparison:
    """Detect and measure the trees of one frame, compare them with the ground truth, draw them.

    The trees of the comparison are sorted from near to far. The picture shows their position in
    the comparison, counted from 1, or "?" for a detection that matches no labelled tree.
    """
    x, y, z = sample.up_camera.tolist()
    frame = sample.read()
    result = process(
        frame, detector, Rig(sample.camera, up_camera=(x, y, z), uncertainty=EXACT_RIG)
    )
    trees, measurements = result.trees, result.measurements
    assert frame.depth_m is not None
    assert measurements is not None
    truths = sorted(sample.trees, key=lambda tree: tree.distance_m)
    true_px = np.array([tree.box_px for tree in truths]).reshape(-1, 4)
    matches = match_boxes(trees.boxes_px, true_px)
    numbers = {match.detection: str(match.truth + 1) for match in matches}
    labels = numbered(
        tree_labels(trees, measurements), [numbers.get(n, "?") for n in range(len(trees))]
    )
    shown = picture_of_depth(frame.depth_m) if detector.manifest.takes_depth else frame.image
    assert shown is not None
    drawn = draw_trees(shown, trees, labels, cuts=cut_marks(measurements, sample.camera))
    scores = trees.scores.tolist()
    return compare_trees(frame.name, truths, matches, scores, measurements, jpeg_of(drawn))
