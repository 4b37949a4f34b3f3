"""Types of what `perceptree train` and `perceptree import` write. Units are in the names."""

from __future__ import annotations

from typing import Any, Literal, NotRequired, TypedDict

from basetree.schemas import Count, Share, Side


class Metrics(TypedDict):
    """Summary of an evaluation, average precisions in percent; null for what cannot be known."""

    frames: Count
    trees: Count
    box_ap: float
    box_ap50: float
    mask_ap: float | None
    mask_ap50: float | None
    keypoint_ap: float | None
    keypoint_ap50: float | None
    keypoint_error_px: dict[str, float]
    diameter_error_px: float | None
    recall: Share | None
    precision: Share | None


class Train(TypedDict):
    """`perceptree train --json`."""

    schema: Literal["perceptree.train/1"]
    checkpoint: str
    steps: Count
    elapsed_s: float
    val: Metrics


class LogLine(TypedDict):
    """A line of `log.jsonl` of a training: `val` after an evaluation, or the rest; no `schema`."""

    step: Count
    elapsed_s: float
    losses: NotRequired[dict[str, float]]
    rate: NotRequired[float]
    frames_per_s: NotRequired[float]
    waiting_share: NotRequired[Share]
    val: NotRequired[Metrics]


class Network(TypedDict):
    """Everything that a network is built from; `perceptree.models.ModelSpec` says what it means."""

    name: str
    modality: Literal["rgb", "depth", "both"]
    height: Side
    width: Side
    mean: list[float]
    std: list[float]
    pad_value: Count
    anchor_sizes_px: list[list[float]]
    depth_encoding: dict[str, float] | None
    backbone: str
    stride_in_1x1: bool
    reduction: NotRequired[Count]
    levels: list[int]
    fpn_width: Side
    fpn_norm: bool
    anchor_ratios: list[float]
    anchor_offset: Share
    proposals_per_level: Side
    proposals: Side
    proposal_nms_iou: Share
    roi_levels: list[int]
    roi_samples: Count
    box_head_width: Side
    mask_head_widths: list[int]
    keypoint_head_widths: list[int]
    masks: bool
    keypoints: bool
    keypoint_box_scale: float
    keypoint_grid: Literal["subcell", "pixels"]
    detections: Side
    score_threshold: Share
    nms_iou: Share
    box_voting: NotRequired[bool]
    separable_proposals: NotRequired[bool]
    mask_score_weight: NotRequired[float]
    colour_backbone: NotRequired[str]
    colour_mean: NotRequired[list[float]]
    colour_std: NotRequired[list[float]]
    colour_pad_value: NotRequired[Count]
    colour_reduction: NotRequired[Count]


class Checkpoint(TypedDict):
    """Metadata `perceptree` of a checkpoint; `training` holds settings, data and val of a run."""

    schema: Literal["perceptree.checkpoint/1"]
    spec: Network
    training: dict[str, Any]


class Import(TypedDict):
    """`perceptree import --json`."""

    schema: Literal["perceptree.import/1"]
    checkpoint: str
    model: str | None
    backbone: str
    modality: Literal["rgb", "depth", "both"]
    height: Side
    width: Side
    stride_in: Literal["1x1", "3x3"]
    pixel_mean: list[float]
    pixel_std: list[float]
    anchors_per_cell: Side
    anchor_sizes_px: list[list[float]]
    anchor_ratios: list[float]
    masks: bool
    keypoints: bool
    parameters: Count
    assumed: list[str]
    init_only: bool
    fresh: list[str]
    sha256: str
