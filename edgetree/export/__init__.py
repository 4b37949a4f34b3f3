"""Export: a checkpoint becomes one ONNX file that is proven to find the same trees.

Importing this package is cheap; torch, onnx and perceptree are loaded by the functions.
"""

from edgetree.export.exporter import PRECISIONS, ExportReport, export_model, verify_model
from edgetree.export.parity import ParityFailed, ParityReport

__all__ = [
    "PRECISIONS",
    "ExportReport",
    "ParityFailed",
    "ParityReport",
    "export_model",
    "verify_model",
]
