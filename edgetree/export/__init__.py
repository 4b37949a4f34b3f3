"""Export: a checkpoint becomes one ONNX file that is proven to find the same trees.

Importing this package is cheap; torch, onnx and perceptree are loaded by the functions.
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
