"""Mask R-CNN for trees: model spec, network, training targets and checkpoints."""

from perceptree.models.checkpoint import load_checkpoint, save_checkpoint
from perceptree.models.detector import Detections, TreeRCNN
from perceptree.models.presets import EDGE_PRESETS, PAPER_PRESETS, PRESETS, make_spec
from perceptree.models.spec import CLASS_NAMES, ModelSpec, SpecError
from perceptree.models.targets import TreeTargets
from perceptree.settings.sampling import PAPER_SAMPLING, SampleSettings

__all__ = [
    "CLASS_NAMES",
    "EDGE_PRESETS",
    "PAPER_PRESETS",
    "PAPER_SAMPLING",
    "PRESETS",
    "Detections",
    "ModelSpec",
    "SampleSettings",
    "SpecError",
    "TreeRCNN",
    "TreeTargets",
    "load_checkpoint",
    "make_spec",
    "save_checkpoint",
]
