"""What a detector is: one frozen, checked dataclass that travels with the weights."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal

from perceptree.errors import PerceptreeError

KEYPOINT_NAMES = ("felling_cut", "diameter_left", "diameter_right", "axis_middle", "axis_top")
KEYPOINT_FLIP_PAIRS = ((1, 2),)
CLASS_NAMES = ("tree",)

MASK_CELLS = 28
HEAT_MAP_CELLS = 56

Modality = Literal["rgb", "depth"]


class SpecError(PerceptreeError):
    """A model spec that cannot be built."""


@dataclasses.dataclass(frozen=True)
class ModelSpec:
    """Everything needed to rebuild a network and to feed it correctly.

    Channels are in the order of the input (BGR for ``rgb``, one for ``depth``); ``mean`` and
    ``std`` are in units of the 8-bit input. FPN level ``n`` has stride ``2**n``.
    """

    name: str
    modality: Modality
    height: int
    """Input height, px, a multiple of the coarsest stride."""
    width: int
    """Input width, px, a multiple of the coarsest stride."""
    mean: tuple[float, ...]
    std: tuple[float, ...]
    pad_value: int
    """What the letterbox fills with, 0 to 255."""
    anchor_sizes_px: tuple[float, ...]
    """Square root of an anchor's area, one per level."""
    depth_encoding: dict[str, float] | None = None
    """How metres became 8 bits (``calib.DepthEncoding`` as a dict); None for ``rgb``."""
    backbone: str = "mobilenetv4_conv_small"
    levels: tuple[int, ...] = (3, 4, 5)
    fpn_width: int = 96
    anchor_ratios: tuple[float, ...] = (2.0, 4.5, 10.0)
    """Height over width."""
    proposals_per_level: int = 100
    """Kept per level ahead of the suppression."""
    proposals: int = 100
    """Kept per image after it."""
    proposal_nms_iou: float = 0.7
    roi_levels: tuple[int, ...] = (3,)
    """Levels that the heads pool from; more than one are assigned by box size."""
    box_head_width: int = 256
    mask_head_widths: tuple[int, ...] = (64, 64)
    keypoint_head_widths: tuple[int, ...] = (64, 64, 64, 64)
    masks: bool = True
    keypoints: bool = True
    keypoint_box_scale: float = 1.25
    """The keypoint head sees the box enlarged by this, so that a hidden cut is still inside."""
    detections: int = 20
    """Rows of every output."""
    score_threshold: float = 0.01
    nms_iou: float = 0.5

    def __post_init__(self) -> None:
        channels = {"rgb": 3, "depth": 1}.get(self.modality)
        if channels is None:
            raise SpecError(f"modality is {self.modality!r}, expected 'rgb' or 'depth'")
        self._check_input(channels)
        self._check_levels()
        for name in ("proposals_per_level", "proposals", "detections", "fpn_width"):
            if getattr(self, name) < 1:
                raise SpecError(f"{name} is {getattr(self, name)}, expected at least 1")
        for name in ("proposal_nms_iou", "nms_iou"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise SpecError(f"{name} is {getattr(self, name)}, expected over 0, at most 1")
        if not 0.0 <= self.score_threshold < 1.0:
            raise SpecError(f"score_threshold is {self.score_threshold}, expected within [0, 1)")
        if self.keypoint_box_scale < 1.0:
            raise SpecError(f"keypoint_box_scale is {self.keypoint_box_scale}, expected >= 1")

    def _check_input(self, channels: int) -> None:
        if len(self.mean) != channels or len(self.std) != channels:
            raise SpecError(
                f"mean and std have {len(self.mean)} and {len(self.std)} values, "
                f"expected {channels} for {self.modality}"
            )
        if min(self.std) <= 0.0:
            raise SpecError(f"std is {self.std}, expected positive values")
        if not 0 <= self.pad_value <= 255:
            raise SpecError(f"pad_value is {self.pad_value}, expected 0 to 255")
        if (self.depth_encoding is None) != (self.modality == "rgb"):
            raise SpecError("depth_encoding is for the depth modality, which needs it")

    def _check_levels(self) -> None:
        first = self.levels[0] if self.levels else 0
        if first < 2 or self.levels != tuple(range(first, first + len(self.levels))):
            raise SpecError(f"levels are {self.levels}, expected consecutive ones from 2 on")
        if self.levels[-1] > 5:
            raise SpecError(f"levels are {self.levels}, expected at most level 5")
        stride = 2 ** max(5, self.levels[-1])
        if min(self.height, self.width) < stride or self.height % stride or self.width % stride:
            raise SpecError(
                f"the input is {self.height}x{self.width}, expected multiples of {stride}"
            )
        if len(self.anchor_sizes_px) != len(self.levels) or not self.anchor_ratios:
            raise SpecError(
                f"{len(self.anchor_sizes_px)} anchor sizes and {len(self.anchor_ratios)} ratios, "
                f"expected {len(self.levels)} sizes (one per level) and at least one ratio"
            )
        if not self.roi_levels or not set(self.roi_levels) <= set(self.levels):
            raise SpecError(f"roi_levels are {self.roi_levels}, expected some of {self.levels}")

    @property
    def channels(self) -> int:
        """Channels of the input."""
        return len(self.mean)

    def to_dict(self) -> dict[str, Any]:
        """As plain values that JSON can hold."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> ModelSpec:
        """Rebuild from :meth:`to_dict`; raises SpecError for unknown or missing fields."""
        known = {field.name for field in dataclasses.fields(cls)}
        surplus = sorted(set(values) - known)
        if surplus:
            raise SpecError(f"unknown model spec fields: {', '.join(surplus)}")
        plain: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in values.items()
        }
        try:
            return cls(**plain)
        except TypeError as error:
            raise SpecError(f"not a model spec: {error}") from error


LINEAR_20_M = {
    "near_m": 0.0,
    "far_m": 20.0,
    "near_value": 0,
    "far_value": 255,
    "invalid_value": 255,
}


def light_spec(modality: Modality, height: int = 384, width: int = 640) -> ModelSpec:
    """The light detector for two-core computers; anchors scale with the input's width."""
    scale = width / 640.0
    depth = modality == "depth"
    return ModelSpec(
        name=f"light-{modality}",
        modality=modality,
        height=height,
        width=width,
        mean=(128.0,) if depth else (103.53, 116.28, 123.675),
        std=(80.0,) if depth else (57.375, 57.12, 58.395),
        pad_value=255 if depth else 114,
        anchor_sizes_px=(40.0 * scale, 80.0 * scale, 160.0 * scale),
        depth_encoding=dict(LINEAR_20_M) if depth else None,
    )
