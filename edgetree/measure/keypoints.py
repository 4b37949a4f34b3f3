"""The keypoints of trees, with their errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from basetree.arrays import Bool, Float
from calib.directions import lengths
from edgetree.detections import KEYPOINT_NAMES, TreeDetections
from edgetree.measure.constants.outlines import (
    BORDER_KEYPOINT_STDS,
    CLIPPED_GAP_PX,
    LOWER_SIDE_PX,
    MIN_LOWER_SIDE_PX,
    NEAR_SIDE_STD,
    NEAR_SIDE_WIDTHS,
    REACHES_SIDE_SHARE,
    UNSEEN_SCORE,
)
from edgetree.measure.constants.stems import HIGHEST_CUT_M, LOWEST_CUT_M
from edgetree.measure.settings import MeasureSettings, network_std_px, reference_px

CUT, LEFT, RIGHT, MIDDLE, TOP = range(len(KEYPOINT_NAMES))

MIN_WIDTH_PX = 1.0
"""Smallest distance between the left and the right edge of the diameter's section."""


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
        clipped_by_side: (T, 2) whether the left or the right side of the image may cut the stem
            off: its box ends near that side, and the edge keypoint there is not seen.
        reaches_lower_side: (T,) whether the box ends at the lower side of the image.
        section_above_px: (T,) height of the section's keypoints above the lower side of the image;
            infinite where their errors are too small for them to be below it.
        offered: Whether the model predicts keypoints.
        unseen: (T,) whether a network sees none of the section's edges.
    """

    xy_px: Float
    given: Bool
    std_px: Float
    within: Bool
    doubtful_cut_px: Float
    clipped_by_side: Bool
    reaches_lower_side: Bool
    section_above_px: Float
    offered: bool
    unseen: Bool

    @classmethod
    def from_detections(cls, trees: TreeDetections, settings: MeasureSettings) -> Keypoints:
        """Take the keypoints of detections and estimate their errors.

        The standard deviations are those of the heat maps, where the model gives these. Else they
        grow with 1 / sqrt(score), see `MeasureSettings.keypoint_spread`, and with the size of the
        box: across the stem with its width, along the stem with the square root of its area.
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
        if trees.keypoint_stds_px is not None:
            share = np.array([settings.keypoint_heat, settings.keypoint_heat_slide])
            heat_px = share * trees.keypoint_stds_px.astype(np.float64)
            spread = np.where(heat_px > 0, heat_px, spread)
        least_px = settings.keypoint_std_px * reference_px(trees.image_width)
        if trees.by_network:
            least_px = network_std_px(settings.keypoint_std_px, trees.image_width)
        std_px = np.hypot(least_px, spread)
        clipped = _clipped_by_side(trees, values[:, [LEFT, RIGHT], 2])
        std_px[..., 0] = np.hypot(std_px[..., 0], _near_side_std_px(trees, values, clipped))
        given = (values[..., 2] > 0) & near
        inside = (values[..., :2] > std_px) & (values[..., :2] < size - std_px)
        within = given & inside.all(2)
        # If the stem reaches the lower border, the cut may be below the image. Networks then
        # predict a point inside the image.
        cut_std_px = std_px[:, CUT, 1]
        reaches_border = trees.boxes_px[:, 3] > trees.image_height - np.maximum(cut_std_px, 1.0)
        above_border_px = trees.image_height - values[:, CUT, 1]
        doubtful = given[:, CUT] & (above_border_px > 0) & reaches_border
        doubtful &= above_border_px < BORDER_KEYPOINT_STDS * cut_std_px
        within[:, CUT] &= ~doubtful
        lower_side_px = LOWER_SIDE_PX * reference_px(trees.image_width)
        if trees.by_network:
            lower_side_px = max(lower_side_px, MIN_LOWER_SIDE_PX)
        reaches_lower_side = trees.boxes_px[:, 3] > trees.image_height - lower_side_px
        # Where the lower side cuts a stem off, a network's unseen edge keypoints are anywhere.
        unseen = (values[:, [LEFT, RIGHT], 2] < UNSEEN_SCORE).all(1) & trees.by_network
        within[:, [LEFT, RIGHT]] &= ~(unseen & reaches_lower_side)[:, None]
        return cls(
            xy_px=values[..., :2],
            given=given,
            std_px=std_px,
            within=within,
            doubtful_cut_px=np.where(doubtful, above_border_px, np.nan),
            clipped_by_side=clipped,
            reaches_lower_side=reaches_lower_side,
            section_above_px=_section_above_px(values, std_px, trees.image_height),
            offered=trees.keypoints_px is not None,
            unseen=np.asarray(unseen),
        )

    def cut_stds_px(self, above_m: Float) -> Float:
        """(T,) standard deviations of the felling cuts along the stems; NaN where none is told.

        Args:
            above_m: (T,) their heights above the sections, which have to be plausible.
        """
        told = self.offered & self.within[:, CUT]
        told &= (above_m >= LOWEST_CUT_M) & (above_m <= HIGHEST_CUT_M)
        return np.where(told, self.std_px[:, CUT, 1], np.nan)

    def without_foot(self, stems: Bool) -> Keypoints:
        """The same without sections and cuts of some of the stems, chosen by flags (T,)."""
        within = self.within.copy()
        within[:, [CUT, LEFT, RIGHT]] &= ~stems[:, None]
        return replace(self, within=within)

    @cached_property
    def has_section(self) -> Bool:
        """(T,) whether both edges of the diameter's section are in the image and distinct."""
        width = lengths(self.xy_px[:, RIGHT] - self.xy_px[:, LEFT])
        size_known = width >= MIN_WIDTH_PX
        return np.asarray(self.within[:, LEFT] & self.within[:, RIGHT] & size_known)


def _section_above_px(values: Float, std_px: Float, image_height: int) -> Float:
    """`Keypoints.section_above_px` of keypoints (T, 5, 3) with errors (T, 5, 2)."""
    edges = [LEFT, RIGHT]
    above_px = image_height - values[:, edges, 1].max(1)
    near = above_px < BORDER_KEYPOINT_STDS * std_px[:, edges, 1].max(1)
    return np.where(near, above_px, np.inf)


def _clipped_by_side(trees: TreeDetections, edge_scores: Float) -> Bool:
    """(T, 2) whether the left or the right side of the image may cut the stems off.

    Args:
        trees: The detections.
        edge_scores: (T, 2) scores of the keypoints of the left and the right edge.
    """
    left_px, right_px = trees.boxes_px[:, 0], trees.image_width - trees.boxes_px[:, 2]
    gaps_px = np.stack([left_px, right_px], 1)
    unseen = (edge_scores < UNSEEN_SCORE) & (trees.keypoints_px is not None)
    return np.asarray(unseen & (gaps_px < CLIPPED_GAP_PX * reference_px(trees.image_width)))


def _near_side_std_px(trees: TreeDetections, values: Float, clipped: Bool) -> Float:
    """(T, 5) standard deviations of edge keypoints that may be beyond a side of the image, else 0.

    Args:
        trees: The detections.
        values: (T, 5, 3) their keypoints.
        clipped: (T, 2) whether the edge there is not seen, from `_clipped_by_side`.
    """
    std_px = np.zeros(values.shape[:2])
    picked = [LEFT, RIGHT]
    x_px = values[:, picked, 0]
    width_px = np.abs(x_px[:, 1] - x_px[:, 0])[:, None]
    left_px, right_px = trees.boxes_px[:, 0], trees.boxes_px[:, 2]
    reach_px = REACHES_SIDE_SHARE * (right_px - left_px)
    near_px = NEAR_SIDE_WIDTHS * width_px
    beyond = clipped | ((left_px < reach_px)[:, None] & (x_px < near_px))
    size = trees.image_width
    beyond |= (right_px > size - reach_px)[:, None] & (x_px > size - near_px)
    std_px[:, picked] = np.where(beyond, NEAR_SIDE_STD * width_px, 0.0)
    return std_px
