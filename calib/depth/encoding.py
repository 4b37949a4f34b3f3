"""Depth maps as 8-bit images, the input format of the networks."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, cast

import cv2
import numpy as np

from basetree.arrays import Float, Float32, UInt8
from calib.errors import DepthError

_MIN_READING_M, _MAX_READING_M = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)


@dataclass(frozen=True)
class DepthEncoding:
    """Linear mapping from metres to 8-bit values, clamped outside the range.

    Attributes:
        near_m: Depth encoded as `near_value`, in metres.
        far_m: Depth encoded as `far_value`, in metres.
        near_value: Grey value of `near_m` and nearer, 0 to 255.
        far_value: Grey value of `far_m` and farther, 0 to 255.
        invalid_value: Grey value of pixels without a reading, 0 to 255.

    Raises:
        DepthError: If a value is out of range, or if near and far coincide.
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
            raise DepthError(
                f"near_value and far_value are both {self.far_value}: expected different values"
            )

    def to_dict(self) -> dict[str, float]:
        """Return JSON-ready values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> DepthEncoding:
        """Create an encoding from the values of `to_dict`.

        Raises:
            DepthError: If a field is missing, unknown or not a number.
        """
        names = {field.name for field in fields(cls)}
        if not isinstance(values, Mapping) or set(values) != names:
            found = sorted(map(str, values)) if isinstance(values, Mapping) else repr(values)
            raise DepthError(f"depth encoding has fields {found}: expected {sorted(names)}")
        for name, value in values.items():
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            fits = isinstance(value, float) and not name.endswith("_value")
            if not is_number or not (fits or abs(value) <= sys.float_info.max):
                raise DepthError(f"depth encoding field {name} is {value!r}: expected a number")
        return cls(
            float(values["near_m"]),
            float(values["far_m"]),
            int(values["near_value"]),
            int(values["far_value"]),
            int(values["invalid_value"]),
        )


def encode_depth(depth_m: Float, encoding: DepthEncoding) -> UInt8:
    """Encode a depth map in 8 bits.

    Args:
        depth_m: (H, W) metres; values that are not positive and finite are missing.
        encoding: The encoding.

    Returns:
        (H, W) uint8, `invalid_value` for missing readings.

    Examples:
        >>> import numpy as np
        >>> from calib import DepthEncoding, encode_depth
        >>> encode_depth(np.array([[0.0, 2.0, 5.0, 10.0]], np.float32), DepthEncoding())
        array([[255,  26,  64, 128]], dtype=uint8)
    """
    metres = np.ascontiguousarray(depth_m, np.float32)
    low, high = sorted((encoding.near_value, encoding.far_value))
    per_m = (encoding.far_value - encoding.near_value) / (encoding.far_m - encoding.near_m)
    offset = encoding.near_value - encoding.near_m * per_m
    # Values beyond 32 bits would overflow to the other end of the range.
    _, near = cv2.threshold(metres, encoding.far_m, 0.0, cv2.THRESH_TRUNC)
    grey = cv2.addWeighted(near, per_m, near, 0.0, offset, dtype=cv2.CV_8U)
    grey = np.clip(grey, low, high, out=grey)
    reading = cv2.inRange(metres, _MIN_READING_M, _MAX_READING_M)  # 0 for NaN and infinity
    unknown = np.full(metres.shape, encoding.invalid_value, np.uint8)
    return cast("UInt8", cv2.copyTo(grey, reading, unknown))


def decode_depth(grey: UInt8, encoding: DepthEncoding) -> Float32:
    """Decode an 8-bit depth map.

    Args:
        grey: (H, W) uint8.
        encoding: The encoding.

    Returns:
        (H, W) float32 metres. Pixels with `invalid_value`, at or beyond `far_value`, or on the
        other side of `near_value` become 0, because their depth is unknown.
    """
    share = (grey.astype(np.float32) - encoding.near_value) / (
        encoding.far_value - encoding.near_value
    )
    depth_m = encoding.near_m + share * (encoding.far_m - encoding.near_m)
    unknown = (grey == encoding.invalid_value) | (share >= 1) | (share < 0)
    return np.where(unknown, 0, depth_m).astype(np.float32)
