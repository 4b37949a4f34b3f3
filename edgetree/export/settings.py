"""What an export may choose: one frozen, checked dataclass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from edgetree.errors import InputError

__all__ = ["OPSET", "PRECISIONS", "TARGETS", "ExportSettings"]

OPSET: Final = 20
_OPSETS: Final = range(18, 24)
PRECISIONS: Final = {"fp32": "float32", "fp16": "float16", "int8": "int8"}
TARGETS: Final = ("cpu", "cuda", "tensorrt", "openvino", "coreml", "directml")
# What runs a file in 8 bits at least as fast as in float: the others convert back to float.
_INT8_TARGETS: Final = ("cpu", "tensorrt", "openvino")
_LARGEST: Final = {"batch": 64, "max_detections": 1000, "proposals": 10000}


@dataclass(frozen=True)
class ExportSettings:
    """What the file is to be; None keeps what the checkpoint says.

    Attributes:
        height: of the graph's input, px.
        width: of the graph's input, px.
        batch: frames of one inference.
        max_detections: rows of every output, filled or not.
        proposals: regions that the box head looks at, per frame.
        precision: a key of ``PRECISIONS``.
        score_threshold: lowest score that the graph keeps, 0 to 1.
        opset: ONNX operator set, 18 to 23.
        target: the provider that the file is for, one of ``TARGETS``; it decides how ``int8``
            stores activations.

    Raises:
        InputError: a value out of its range, or a precision that the target does not run.
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
