"""Options of an export."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from basetree.errors import InputError
from basetree.settings import Settings, label, limits, names, option, shown_default

OPSET: Final = 20
PRECISIONS: Final = {"fp32": "float32", "fp16": "float16", "int8": "int8"}
TARGETS: Final = ("cpu", "cuda", "tensorrt", "openvino", "coreml", "directml")
# Targets that run 8-bit files at least as fast as float32 files. The others convert to float.
_INT8_TARGETS: Final = ("cpu", "tensorrt", "openvino")
EVERY_ROW_TARGETS: Final = ("tensorrt",)
"""Targets that are slow where the number of boxes that the last heads run on varies."""


@dataclass(frozen=True)
class ExportSettings(Settings, error=InputError):
    """Options of an export. None keeps the value of the checkpoint."""

    height: int | None = None
    """Height of the input in px."""
    width: int | None = None
    """Width of the input in px."""
    batch: int = field(default=1, metadata=limits(1, 64))
    """Frames per inference."""
    max_detections: int | None = field(default=None, metadata=limits(1, 1000))
    """Number of rows of each output."""
    proposals: int | None = field(default=None, metadata=limits(1, 10000))
    """Region proposals per frame, which the box head classifies."""
    precision: str = field(default="fp32", metadata=names(PRECISIONS))
    """Numbers of the file: fp16 for GPUs; int8 for CPUs, OpenVINO and TensorRT."""
    inputs: str | None = field(
        default=None, metadata=names(("both", "depth", "colour")) | shown_default("all it has")
    )
    """Inputs of a model of colour and depth: the branch of the other one is left out."""
    score_threshold: float | None = field(
        default=None, metadata=limits(0, under=1, expected="0 or more, under 1")
    )
    """Lowest score in the outputs."""
    opset: int = field(default=OPSET, metadata=limits(18, 23))
    """ONNX operator set."""
    target: str = field(
        default="cpu", metadata=names(TARGETS) | label("provider") | option("--provider")
    )
    """Target provider, which will run the file. It decides how int8 stores activations."""

    def _check_together(self) -> None:
        if self.precision == "int8" and self.target not in _INT8_TARGETS:
            self._refuse("precision is 'int8'", f"fp32 or fp16 for the provider {self.target}")
