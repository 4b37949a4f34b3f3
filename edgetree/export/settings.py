"""Options of an export."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from basetree.errors import InputError

__all__ = ["OPSET", "PRECISIONS", "TARGETS", "ExportSettings"]

OPSET: Final = 20
_OPSETS: Final = range(18, 24)
PRECISIONS: Final = {"fp32": "float32", "fp16": "float16", "int8": "int8"}
TARGETS: Final = ("cpu", "cuda", "tensorrt", "openvino", "coreml", "directml")
# Targets that run 8-bit files at least as fast as float32 files. The others convert to float.
_INT8_TARGETS: Final = ("cpu", "tensorrt", "openvino")
_LARGEST: Final = {"batch": 64, "max_detections": 1000, "proposals": 10000}


@dataclass(frozen=True)
class ExportSettings:
    """Options of an export. None keeps the value of the checkpoint.

    Attributes:
        height: height of the graph's input in pixels.
        width: width of the graph's input in pixels.
        batch: number of frames of one inference, 1 to 64.
        max_detections: number of rows of every output, 1 to 1000.
        proposals: number of regions per frame that the box head classifies, 1 to 10000.
        precision: ``fp32``, ``fp16`` or ``int8``.
        score_threshold: lowest score of a detection, 0 or more and under 1.
        opset: ONNX operator set, 18 to 23.
        target: execution provider that will run the file, one of ``TARGETS``. It decides how
            ``int8`` stores activations.

    Raises:
        InputError: a value is out of its range, or the target does not support the precision.
    """

    height: int | None = None
    width: int | None = None
    batch: int = 1
    max_detections: int | None = None
    proposals: int | None = None
    precision: str = "fp32"
    score_threshold: float | None = None
    opset: int = OPSET
    target: str = "cpu"

    def __post_init__(self) -> None:
        if self.precision not in PRECISIONS:
            _refuse("precision", repr(self.precision), f"one of {', '.join(PRECISIONS)}")
        if self.target not in TARGETS:
            _refuse("provider", repr(self.target), f"one of {', '.join(TARGETS)}")
        if self.precision == "int8" and self.target not in _INT8_TARGETS:
            _refuse("precision", "'int8'", f"fp32 or fp16 for the provider {self.target}")
        if self.opset not in _OPSETS:
            _refuse("opset", str(self.opset), f"{_OPSETS[0]} to {_OPSETS[-1]}")
        for name, largest in _LARGEST.items():
            value = getattr(self, name)
            if value is not None and not 1 <= value <= largest:
                _refuse(name, str(value), f"1 to {largest}")
        if self.score_threshold is not None and not 0.0 <= self.score_threshold < 1.0:
            _refuse("score_threshold", str(self.score_threshold), "0 or more, under 1")


def _refuse(name: str, value: str, expected: str) -> None:
    raise InputError(f"{name} is {value}: expected {expected}")
