"""Detect and measure trees with exported models. Needs onnxruntime, not torch.

    from edgetree import TreeDetector, default_model

    detector = TreeDetector.load(default_model("rgb"))
    trees = detector.detect(image)  # uint8 (H, W, 3) BGR

Importing this package is fast: public names are imported on first use, and onnxruntime when a
model is opened.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edgetree.detections import KEYPOINT_NAMES, TreeDetections
    from edgetree.drawing import draw_trees
    from edgetree.errors import (
        CheckFailed,
        EdgetreeError,
        InputError,
        MissingDependency,
        ModelFileError,
        SignatureError,
    )
    from edgetree.model_file import Manifest
    from edgetree.runtime import TreeDetector, default_model
    from edgetree.samples import SampleFrame, SampleTree, sample_frames

# onnxruntime sends usage data to its maker, unless this is set before it is loaded.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

__all__ = [
    "KEYPOINT_NAMES",
    "CheckFailed",
    "EdgetreeError",
    "InputError",
    "Manifest",
    "MissingDependency",
    "ModelFileError",
    "SampleFrame",
    "SampleTree",
    "SignatureError",
    "TreeDetections",
    "TreeDetector",
    "default_model",
    "draw_trees",
    "sample_frames",
]

_MODULES = {
    "KEYPOINT_NAMES": "detections",
    "CheckFailed": "errors",
    "EdgetreeError": "errors",
    "InputError": "errors",
    "Manifest": "model_file",
    "MissingDependency": "errors",
    "ModelFileError": "errors",
    "SampleFrame": "samples",
    "SampleTree": "samples",
    "SignatureError": "errors",
    "TreeDetections": "detections",
    "TreeDetector": "runtime",
    "default_model": "runtime",
    "draw_trees": "drawing",
    "sample_frames": "samples",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"edgetree.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
