"""Depth maps: metres in memory (0 = no reading), millimetres or the paper's 8 bits on disk."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import DepthError, InputFileError

_MM_PER_M = 1000.0
_MAX_MM = 65535
_SMALLEST_M, _LARGEST_M = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)


@dataclass(frozen=True)
class DepthEncoding:
    """The rule between metres and 8 bits: linear from near to far, clamped beyond.

    ``near_value`` and ``far_value`` are the greys at ``near_m`` and ``far_m``;
    ``invalid_value`` stands for no reading.
    """

    near_m: float = 0.0
    far_m: float = 20.0
    near_value: int = 0
    far_value: int = 255
    invalid_value: int = 255

    def __post_init__(self) -> None:
        if not (math.isfinite(self.near_m) and math.isfinite(self.far_m)) or not (
            0 <= self.near_m < self.far_m
        ):
            raise DepthError(
                f"near_m is {self.near_m} and far_m {self.far_m}: expected 0 <= near_m < far_m"
            )
        for name in ("near_value", "far_value", "invalid_value"):
            if not 0 <= getattr(self, name) <= 255:
                raise DepthError(f"{name} is {getattr(self, name)}: expected 0 to 255")
        if self.near_value == self.far_value:
            raise DepthError(f"near_value and far_value are both {self.far_value}: expected two")

    def to_dict(self) -> dict[str, float]:
        """JSON-ready values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> DepthEncoding:
        """From ``to_dict``'s values; raises DepthError for other fields or types."""
        names = {field.name for field in fields(cls)}
        if set(values) != names:
            raise DepthError(
                f"depth encoding has fields {sorted(values)}: expected {sorted(names)}"
            )
        for name, value in values.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise DepthError(f"depth encoding field {name} is {value!r}: expected a number")
        return cls(
            float(values["near_m"]), float(values["far_m"]), int(values["near_value"]),
            int(values["far_value"]), int(values["invalid_value"]),
        )  # fmt: skip


def encode_depth(depth_m: NDArray[np.floating[Any]], encoding: DepthEncoding) -> NDArray[np.uint8]:
    """(H, W) metres to (H, W) uint8; 0 and anything not finite is no reading."""
    metres = np.ascontiguousarray(depth_m, np.float32)
    low, high = sorted((encoding.near_value, encoding.far_value))
    per_m = (encoding.far_value - encoding.near_value) / (encoding.far_m - encoding.near_m)
    offset = encoding.near_value - encoding.near_m * per_m
    grey = cv2.addWeighted(metres, per_m, metres, 0.0, offset, dtype=cv2.CV_8U)
    grey = np.clip(grey, low, high, out=grey)
    reading = cv2.inRange(metres, _SMALLEST_M, _LARGEST_M)  # false of NaN and infinities
    unknown = np.full(metres.shape, encoding.invalid_value, np.uint8)
    return cast("NDArray[np.uint8]", cv2.copyTo(grey, reading, unknown))


def decode_depth(grey: NDArray[np.uint8], encoding: DepthEncoding) -> NDArray[np.float32]:
    """(H, W) uint8 to (H, W) metres; the greys of far and of no reading become 0."""
    share = (grey.astype(np.float32) - encoding.near_value) / (
        encoding.far_value - encoding.near_value
    )
    depth_m = encoding.near_m + share * (encoding.far_m - encoding.near_m)
    unknown = (grey == encoding.invalid_value) | (share >= 1) | (share < 0)
    return np.where(unknown, 0, depth_m).astype(np.float32)


def read_depth(path: Path | str) -> NDArray[np.float32]:
    """(H, W) metres from a 16-bit single-channel PNG in millimetres, 0 where it has no reading.

    Raises InputFileError for a missing or unreadable file, DepthError for another kind of image.
    """
    path = Path(path)
    if not path.is_file():
        raise InputFileError(f"{path}: no such file, expected a 16-bit depth PNG in millimetres")
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputFileError(f"{path}: not a readable image, expected a 16-bit depth PNG")
    if image.dtype != np.uint16 or image.ndim != 2:
        channels = 1 if image.ndim == 2 else image.shape[2]
        raise DepthError(
            f"{path}: {channels} channel(s) of {image.dtype}, expected one channel of uint16"
            " in millimetres"
        )
    return image.astype(np.float32) / np.float32(_MM_PER_M)


def write_depth(path: Path | str, depth_m: NDArray[np.floating[Any]]) -> None:
    """Write (H, W) metres as a 16-bit PNG in millimetres; beyond 65.535 m is no reading.

    Raises InputFileError where the file cannot be written; a file that was there stays whole.
    """
    path = Path(path)
    millimetres = np.where(np.isfinite(depth_m), np.rint(depth_m * _MM_PER_M), 0)
    millimetres = np.where((millimetres < 0) | (millimetres > _MAX_MM), 0, millimetres)
    data = cv2.imencode(".png", millimetres.astype(np.uint16))[1].tobytes()
    beside = path.with_name(path.name + ".part")
    try:
        beside.write_bytes(data)
        beside.replace(path)
    except OSError as error:
        raise InputFileError(f"{path}: cannot be written ({error.strerror})") from error
