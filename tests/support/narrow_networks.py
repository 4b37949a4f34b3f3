"""Narrow networks, which train and run in a moment, and short trainings of them."""

from __future__ import annotations

from typing import Any

from perceptree.models import ModelSpec, make_spec
from perceptree.training import TrainSettings

NARROW = {
    "fpn_width": 16,
    "box_head_width": 16,
    "mask_head_widths": (8,),
    "keypoint_head_widths": (8,),
}
NARROW_PAPER = {
    "backbone": "resnet18",
    "stride_in_1x1": False,
    "fpn_width": 16,
    "box_head_width": 32,
    "mask_head_widths": (16, 16),
    "keypoint_head_widths": (16, 16),
    "proposals_per_level": 50,
    "proposals": 50,
}


def narrow_spec(
    modality: Any = "depth", height: int = 64, width: int = 128, **changes: Any
) -> ModelSpec:
    """The preset edge-n made narrow, for frames of 128x64 px."""
    return make_spec("edge-n", modality, height, width, **NARROW | changes)


def narrow_paper_spec(height: int = 96, width: int = 160, **changes: Any) -> ModelSpec:
    """The preset r50 made narrow, with a smaller backbone."""
    return make_spec("r50", "rgb", height, width, **NARROW_PAPER | {"detections": 5} | changes)


def short_plan(**changes: Any) -> TrainSettings:
    """A training of four steps, without an evaluation before the end."""
    values: dict[str, Any] = {
        "steps": 4,
        "batch": 2,
        "warmup_steps": 2,
        "evaluate_every_steps": 100,
    }
    if "minutes" in changes:
        values["steps"] = None
    return TrainSettings(**values | changes)
