"""The keypoints of trees, with their errors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgetree.detections import KEYPOINT_NAMES, TreeDetections
from edgetree.measure.section import lengths
from edgetree.measure.settings import MeasureSettings, reference_px

__all__ = [
    "CUT",
    "CUT_OFF_PX",
    "LEFT",
    "MIDDLE",
    "MIN_WIDTH_PX",
    "RIGHT",
    "TOP",
    "Keypoints",
]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

CUT, LEFT, RIGHT, MIDDLE, TOP = range(len(KEYPOINT_NAMES))

MIN_WIDTH_PX = 1.0
"""Smallest distance between the left and the right edge of the diameter's section."""

# A keypoint this many standard deviations from the lower border may be below the image.
_BORDER_STDS = 12.0
# A box reaches the lower side if it ends less than this before it, in px of an image of 1280 px
# width.
_LOWER_SIDE_PX = 10.0

# Where the box reaches a side of the image, edge keypoints this near to it, in widths of the
# section, may be beyond it: networks then predict a point inside the image. Their standard
# deviation grows to this share of the width.
_NEAR_SIDE, _NEAR_SIDE_STD = 0.4, 0.2
# A box reaches a side that is less than this share of its width away.
_REACHES_SIDE = 0.2
# A side of the image may cut a stem off if its box ends less than the first distance before it, in
# px of an image of 1280 px width, and the edge keypoint there has a score below the second value.
# Chosen with `edge-n-depth` on 1,700 frames that it was not trained on: of 254 diameters of stems
# that a side cuts off 95 % lie in their intervals; without these limits it was 86 % of 347. Of 158
# whole stems near a side 157 are still measured.
CUT_OFF_PX, _UNSEEN_SCORE = 30.0, 0.1


@dataclass(frozen=True, eq=False)
class Keypoints:
    """The keypoints of T trees.

    Attributes:
        xy_px: (T, 5, 2) points in the image.
        given: (T, 5) which have a score above 0 and are at most one image size outside the image.
        std_px: (T, 5, 2) standard deviations across and along the stem.
        within: (T, 5) which are certainly inside the image. Points near its border may in truth
            be outside.
        doubtful_cut_px: (T,) how far above the lower border a cut keypoint lies that is not used
            because the stem reaches this border, so that the cut may be below it; NaN elsewhere.
        cut_off: (T, 2) whether the left or the right side of the image may cut the stem off: its
            box ends near that side, and the edge keypoint there is not seen.
        reaches_lower_side: (T,) whether the box ends at the lower side of the image.
        offered: whether the model predicts keypoints.
    """

    xy_px: Float
    given: Flags
    std_px: Float
    within: Flags
    doubtful_cut_px: Float
    cut_off: Flags
    reaches_lower_side: Flags
    offered: bool

    @classmethod
    def of(cls, trees: TreeDetections, settings: MeasureSettings) -> Keypoints:
        """Take the keypoints of detections and estimate their errors.

        The standard deviations grow with 1 / sqrt(score), see `MeasureSettings.keypoint_spread`,
        and with the size of the box: across the stem with its width, along the stem with the
        square root of its area.
        """
        count = len(trees)
        values = np.zeros((count, len(KEYPOINT_NAMES), 3))
        if trees.keypoints_px is not None:
            values = trees.keypoints_px.astype(np.float64)
        size = np.array([trees.image_width, trees.image_height])
        near = (np.abs(values[..., :2] - size / 2) <= 1.5 * size).all(2)
        extent = np.maximum(trees.boxes_px[:, 2:] - trees.boxes_px[:, :2], 0.0).astype(np.float64)
        extent[:, 1] = np.sqrt(extent.prod(1))
        score = np.clip(values[..., 2:], 1e-4, 1.0)
        fraction = np.array([settings.keypoint_spread, settings.keypoint_slide])
        spread = fraction * extent[:, None] / np.sqrt(score)
        std_px = np.hypot(settings.keypoint_std_px * reference_px(trees.image_width), spread)
        cut_off = _cut_off(trees, values[:, [LEFT, RIGHT], 2])
        std_px[..., 0] = np.hypot(std_px[..., 0], _cut_off_std_px(trees, values, cut_off))
        given = (values[..., 2] > 0) & near
        inside = (values[..., :2] > std_px) & (values[..., :2] < size - std_px)
        within = given & inside.all(2)
        # If the stem reaches the lower border, the cut may be below the image. Networks then
        # predict a point inside the image.
        cut_std_px = std_px[:, CUT, 1]
        reaches_border = trees.boxes_px[:, 3] > trees.image_height - np.maximum(cut_std_px, 1.0)
        above_border_px = trees.image_height - values[:, CUT, 1]
        doubtful = given[:, CUT] & (above_border_px > 0) & reaches_border
        doubtful &= above_border_px < _BORDER_STDS * cut_std_px
        within[:, CUT] &= ~doubtful
        lower_side_px = _LOWER_SIDE_PX * reference_px(trees.image_width)
        return cls(
            xy_px=values[..., :2],
            given=given,
            std_px=std_px,
            within=within,
            doubtful_cut_px=np.where(doubtful, above_border_px, np.nan),
            cut_off=cut_off,
            reaches_lower_side=trees.boxes_px[:, 3] > trees.image_height - lower_side_px,
            offered=trees.keypoints_px is not None,
        )

    def section_above_px(self, image_height: int) -> Float:
        """(T,) how far the section's keypoints are above the lower side of the image, in px.

        Infinite where their errors are too small for them to be below it.
        """
        edges = [LEFT, RIGHT]
        above_px = image_height - self.xy_px[:, edges, 1].max(1)
        near = above_px < _BORDER_STDS * self.std_px[:, edges, 1].max(1)
        return np.where(near, above_px, np.inf)

    @cached_property
    def has_section(self) -> Flags:
        """(T,) whether both edges of the diameter's section are in the image and distinct."""
        width = lengths(self.xy_px[:, RIGHT] - self.xy_px[:, LEFT])
        size_known = width >= MIN_WIDTH_PX
        return np.asarray(self.within[:, LEFT] & self.within[:, RIGHT] & size_known)


def _cut_off(trees: TreeDetections, edge_scores: Float) -> Flags:
    """(T, 2) whether the left or the right side of the image may cut the stems off.

    Args:
        trees: the detections.
        edge_scores: (T, 2) scores of the keypoints of the left and the right edge.
    """
    left_px, right_px = trees.boxes_px[:, 0], trees.image_width - trees.boxes_px[:, 2]
    gaps_px = np.stack([left_px, right_px], 1)
    unseen = (edge_scores < _UNSEEN_SCORE) & (trees.keypoints_px is not None)
    return np.asarray(unseen & (gaps_px < CUT_OFF_PX * reference_px(trees.image_width)))


def _cut_off_std_px(trees: TreeDetections, values: Float, cut_off: Flags) -> Float:
    """(T, 5) standard deviations of edge keypoints of stems that a side of the image may cut off.

    Args:
        trees: the detections.
        values: (T, 5, 3) their keypoints.
        cut_off: (T, 2) whether the edge there is not seen, from `_cut_off`.
    """
    std_px = np.zeros(values.shape[:2])
    picked = [LEFT, RIGHT]
    x_px = values[:, picked, 0]
    width_px = np.abs(x_px[:, 1] - x_px[:, 0])[:, None]
    left_px, right_px = trees.boxes_px[:, 0], trees.boxes_px[:, 2]
    reach_px = _REACHES_SIDE * (right_px - left_px)
    near_px = _NEAR_SIDE * width_px
    beyond = cut_off | ((left_px < reach_px)[:, None] & (x_px < near_px))
    size = trees.image_width
    beyond |= (right_px > size - reach_px)[:, None] & (x_px > size - near_px)
    std_px[:, picked] = np.where(beyond, _NEAR_SIDE_STD * width_px, 0.0)
    return std_px
