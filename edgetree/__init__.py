"""Tree detection and measurement on the machine: the runtime, without torch.

    from edgetree import TreeDetector, default_model

    detector = TreeDetector.load(default_model("rgb"))
    trees = detector.detect(image)  # uint8 (H, W, 3) BGR

Importing this package is cheap: names are loaded from their modules when first used, and
onnxruntime when a model is opened.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edgetree.detections import KEYPOINT_NAMES, TreeDetections
    from edgetree.errors import (
        CheckFailed,
        EdgetreeError,
        InputError,
        MissingDependency,
        ModelFileError,
    )
    from edgetree.manifest import Manifest

__all__ = [
    "KEYPOINT_NAMES",
    "CheckFailed",
    "EdgetreeError",
    "InputError",
    "Manifest",
    "MissingDependency",
    "ModelFileError",
    "TreeDetections",
]

_MODULES = {
    "KEYPOINT_NAMES": "detections",
    "CheckFailed": "errors",
    "EdgetreeError": "errors",
    "InputError": "errors",
    "Manifest": "manifest",
    "MissingDependency": "errors",
    "ModelFileError": "errors",
    "TreeDetections": "detections",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"edgetree.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
