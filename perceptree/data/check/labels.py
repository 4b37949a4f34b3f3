"""Check a frame's labels, without its image."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from perceptree.data.coco import FrameRecord, TreeRecord
from perceptree.errors import DatasetError
from perceptree.keypoints import KEYPOINT_NAMES

_BOX_TOLERANCE_PX = 1.0
_ORDER_PX = 1.0
_MASK_TOLERANCE_PX, _MASK_TOLERANCE_SHARE = 3.0, 0.05
_CUT, _LEFT, _RIGHT, _MIDDLE, _TOP = range(len(KEYPOINT_NAMES))


def label_faults(frame: FrameRecord) -> Iterator[tuple[str, int]]:
    """Yield (kind, annotation id) of every problem of a frame's trees."""
    for tree in frame.trees:
        kinds = [*_box_faults(frame, tree), *_order_faults(tree)]
        if tree.segmentation is not None:
            kinds += _mask_faults(frame, tree)
        for kind in kinds:
            yield kind, tree.number


def _box_faults(frame: FrameRecord, tree: TreeRecord) -> Iterator[str]:
    x0, y0, x1, y1 = tree.box_px
    if min(x0, y0, frame.width - x1, frame.height - y1) < -_BOX_TOLERANCE_PX:
        yield "box_outside"


def _order_faults(tree: TreeRecord) -> Iterator[str]:
    """Check the order of the keypoints.

    Left and right are relative to the tree's axis seen upright; above and below are image rows.
    """
    points, labelled = tree.keypoints[:, :2], tree.keypoints[:, 2] > 0
    if labelled[[_LEFT, _RIGHT]].all():
        up = np.array([0.0, -1.0])
        for upper in (_TOP, _MIDDLE):
            if labelled[[_CUT, upper]].all() and points[upper, 1] < points[_CUT, 1]:
                up = points[upper] - points[_CUT]
                break
        across = np.array([-up[1], up[0]]) / np.hypot(*up)  # points right of an upright trunk
        if float((points[_RIGHT] - points[_LEFT]) @ across) < -_ORDER_PX:
            yield "left_right_swapped"
    for lower, upper, kind in (
        (_CUT, _MIDDLE, "cut_above_middle"),
        (_MIDDLE, _TOP, "middle_above_top"),
    ):
        if labelled[[lower, upper]].all() and points[lower, 1] < points[upper, 1] - _ORDER_PX:
            yield kind


def _mask_faults(frame: FrameRecord, tree: TreeRecord) -> Iterator[str]:
    try:
        mask = frame.mask(tree)
    except DatasetError:
        yield "mask_broken"
        return
    columns, rows = np.flatnonzero(mask.any(0)), np.flatnonzero(mask.any(1))
    if not len(columns):
        yield "mask_empty"
        return
    start_px, end_px = tree.box_px[:2], tree.box_px[2:]
    first_px = np.array([columns[0], rows[0]])
    last_px = np.array([columns[-1] + 1, rows[-1] + 1])
    slack_px = np.maximum(_MASK_TOLERANCE_PX, _MASK_TOLERANCE_SHARE * (last_px - first_px))
    as_corners_px = np.abs([start_px - first_px, end_px - start_px - last_px])
    if (as_corners_px <= slack_px).all() and (np.abs(end_px - last_px) > slack_px).any():
        yield "box_of_corners"
        return
    slack_px = np.maximum(_MASK_TOLERANCE_PX, _MASK_TOLERANCE_SHARE * (end_px - start_px))
    if (np.maximum(start_px - first_px, last_px - end_px) > slack_px).any():
        yield "mask_outside_box"
