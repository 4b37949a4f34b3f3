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

from basetree.deprecation import moved_names

if TYPE_CHECKING:
    from basetree.errors import CheckFailed, EdgetreeError, InputError, MissingPackage
    from edgetree.detections import KEYPOINT_NAMES, TreeDetections
    from edgetree.drawing import draw_trees
    from edgetree.errors import ModelFileError, SignatureError
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
    "MissingPackage",
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
    "KEYPOINT_NAMES": "edgetree.detections",
    "CheckFailed": "basetree.errors",
    "EdgetreeError": "basetree.errors",
    "InputError": "basetree.errors",
    "Manifest": "edgetree.model_file",
    "MissingPackage": "basetree.errors",
    "ModelFileError": "edgetree.errors",
    "SampleFrame": "edgetree.samples",
    "SampleTree": "edgetree.samples",
    "SignatureError": "edgetree.errors",
    "TreeDetections": "edgetree.detections",
    "TreeDetector": "edgetree.runtime",
    "default_model": "edgetree.runtime",
    "draw_trees": "edgetree.drawing",
    "sample_frames": "edgetree.samples",
}
_moved = moved_names(__name__, {"MissingDependency": "basetree.errors.MissingPackage"})


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        return _moved(name)
    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
