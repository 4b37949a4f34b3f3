"""Mask R-CNN for trees: spec, network, targets, checkpoints."""

from perceptree.models.checkpoint import load_checkpoint, save_checkpoint
from perceptree.models.detector import Detections, TreeRCNN
from perceptree.models.spec import (
    CLASS_NAMES,
    KEYPOINT_FLIP_PAIRS,
    KEYPOINT_NAMES,
    ModelSpec,
    SpecError,
    light_spec,
)
from perceptree.models.targets import TreeTargets

__all__ = [
    "CLASS_NAMES",
    "KEYPOINT_FLIP_PAIRS",
    "KEYPOINT_NAMES",
    "Detections",
    "ModelSpec",
    "SpecError",
    "TreeRCNN",
    "TreeTargets",
    "light_spec",
    "load_checkpoint",
    "save_checkpoint",
]
