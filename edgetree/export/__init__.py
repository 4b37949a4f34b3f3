"""Export checkpoints to ONNX files that are verified to give the same detections.

Importing this package is fast: what builds and verifies files is imported on first use, and its
functions import torch, onnx and perceptree when called.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from edgetree.export.settings import PRECISIONS, TARGETS, ExportSettings

if TYPE_CHECKING:
    from edgetree.export.combining import CombinedModel, combine_models
    from edgetree.export.exporter import ExportReport, export_model, export_preset, verify_model
    from edgetree.export.parity import ParityFailed, ParityReport

__all__ = [
    "PRECISIONS",
    "TARGETS",
    "CombinedModel",
    "ExportReport",
    "ExportSettings",
    "ParityFailed",
    "ParityReport",
    "combine_models",
    "export_model",
    "export_preset",
    "verify_model",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = "parity" if name.startswith("Parity") else "exporter"
    if name in ("CombinedModel", "combine_models"):
        module = "combining"
    return getattr(importlib.import_module(f"{__name__}.{module}"), name)
