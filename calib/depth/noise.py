"""Noise models of depth sensors."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.errors import DepthError

Float = NDArray[np.floating[Any]]


class _Noise(ABC):
    """Base class: Gaussian noise with a standard deviation that depends on the depth."""

    @abstractmethod
    def std_m(self, depth_m: ArrayLike) -> Float:
        """Return (...) standard deviations in metres at (...) metres along z; 0 for no reading."""

    def sample(self, depth_m: ArrayLike, rng: np.random.Generator) -> NDArray[np.float32]:
        """Add noise to true depths.

        Args:
            depth_m: (...) true metres along z, 0 for no reading.
            rng: Source of the random numbers.

        Returns:
            (...) float32 noisy metres; results below 0 become 0, no reading.
        """
        depths = np.asarray(depth_m, np.float64)
        read_m = depths + self.std_m(depths) * rng.standard_normal(depths.shape)
        return np.asarray(np.maximum(read_m, 0), np.float32)


@dataclass(frozen=True)
class StereoNoise(_Noise):
    """Stereo camera: the standard deviation grows with the square of the depth.

    From z = f b / d: std(z) = z^2 std(d) / (f b).

    Attributes:
        baseline_m: Distance between the two cameras in metres.
        fx_px: Focal length in px.
        disparity_std_px: Standard deviation of the disparity in px.

    Raises:
        DepthError: If a value is not above 0.
    """

    baseline_m: float
    fx_px: float
    disparity_std_px: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0):
                raise DepthError(f"{field.name} is {value}: expected a positive number")

    def std_m(self, depth_m: ArrayLike) -> Float:
        """Return (...) standard deviations in metres at (...) metres along z; 0 for no reading."""
        depths = np.asarray(depth_m, np.float64)
        return np.asarray(depths**2 * (self.disparity_std_px / (self.fx_px * self.baseline_m)))


@dataclass(frozen=True)
class TofNoise(_Noise):
    """Time-of-flight camera: the standard deviation grows linearly with the depth.

    Attributes:
        offset_m: Standard deviation at zero depth, in metres.
        per_m: Increase of the standard deviation per metre of depth.

    Raises:
        DepthError: If a value is negative.
    """

    offset_m: float
    per_m: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise DepthError(f"{field.name} is {value}: expected 0 or more")

    def std_m(self, depth_m: ArrayLike) -> Float:
        """Return (...) standard deviations in metres at (...) metres along z; 0 for no reading."""
        depths = np.asarray(depth_m, np.float64)
        return np.where(depths > 0, self.offset_m + self.per_m * depths, 0.0)
