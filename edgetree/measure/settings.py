"""What the measurement assumes about sensor, model and forest."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from edgetree.errors import InputError

__all__ = ["MeasureSettings"]


@dataclass(frozen=True)
class MeasureSettings:
    """Assumptions of `measure_trees`; all positive.

    Attributes:
        keypoint_std_px: least error of a keypoint, in pixels of the image.
        keypoint_spread: error of a keypoint as a share of its box's extent where its score is 1;
            it grows with the inverse root of the score, as the peak p of a normal heat map of
            deviation s is 1 / (2 pi s²). The default is a 56-cell map over a box enlarged by
            1.25, and holds for the embedded depth model on frames that it was not trained on.
        depth_noise_per_m: standard deviation of the depth in metres at 1 m; at z metres it is
            z² times that, as with stereo.
        depth_correlation_px: depth within squares of so many pixels has one error.
        out_of_round_std: how far the diameter of a real stem differs with the side it is seen
            from, as a share of it.
        bend_std_deg: how far the axis of a real stem turns along it.
        lean_std_deg: how far stems lean from the vertical, before looking.
        max_range_m: depth beyond it is not used.
        max_diameter_m: stems that seem thicker are refused.
        max_slope_deg: ground that seems steeper is refused.

    Raises:
        InputError: a value is not a positive number.
    """

    keypoint_std_px: float = 1.0
    keypoint_spread: float = 0.009
    depth_noise_per_m: float = 0.002
    depth_correlation_px: float = 6.0
    out_of_round_std: float = 0.018
    bend_std_deg: float = 0.5
    lean_std_deg: float = 6.0
    max_range_m: float = 25.0
    max_diameter_m: float = 2.5
    max_slope_deg: float = 45.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{field.name} is {value}: expected a positive number")
