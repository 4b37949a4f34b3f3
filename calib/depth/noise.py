"""How far depth readings scatter, by the way they were made."""

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
    """What the models share: their standard deviation decides how readings scatter."""

    @abstractmethod
    def std_m(self, depth_m: ArrayLike) -> Float:
        """(...) metres of standard deviation at (...) metres along z; 0 where no reading is."""

    def sample(self, depth_m: ArrayLike, rng: np.random.Generator) -> NDArray[np.float32]:
        """(...) true metres as the sensor might read them; a reading below 0 is lost."""
        depths = np.asarray(depth_m, np.float64)
        read_m = depths + self.std_m(depths) * rng.standard_normal(depths.shape)
        return np.asarray(np.maximum(read_m, 0), np.float32)


@dataclass(frozen=True)
class StereoNoise(_Noise):
    """A stereo pair matched to ``disparity_std_px``: the scatter grows with z squared.

    From z = f b / d: std(z) = z^2 std(d) / (f b). Raises DepthError for values not above 0.
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
        """(...) metres of standard deviation at (...) metres along z; 0 where no reading is."""
        depths = np.asarray(depth_m, np.float64)
        return np.asarray(depths**2 * (self.disparity_std_px / (self.fx_px * self.baseline_m)))


@dataclass(frozen=True)
class TofNoise(_Noise):
    """A time-of-flight sensor: ``offset_m`` of scatter and ``per_m`` more for each metre.

    Raises DepthError for negative values.
    """

    offset_m: float
    per_m: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise DepthError(f"{field.name} is {value}: expected 0 or more")

    def std_m(self, depth_m: ArrayLike) -> Float:
        """(...) metres of standard deviation at (...) metres along z; 0 where no reading is."""
        depths = np.asarray(depth_m, np.float64)
        return np.where(depths > 0, self.offset_m + self.per_m * depths, 0.0)
