"""Export checkpoints to ONNX files that are verified to give the same detections.

Importing this package is fast: its functions import torch, onnx and perceptree when called.
"""

from edgetree.export.exporter import ExportReport, export_model, export_preset, verify_model
from edgetree.export.parity import ParityFailed, ParityReport
from edgetree.export.settings import PRECISIONS, TARGETS, ExportSettings

__all__ = [
    "PRECISIONS",
    "TARGETS",
    "ExportReport",
    "ExportSettings",
    "ParityFailed",
    "ParityReport",
    "export_model",
    "export_preset",
    "verify_model",
]
