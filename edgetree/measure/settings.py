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
            deviation s is 1 / (2 pi s²).
        keypoint_slide: the same along the stem, where no edge holds the heat map, as a share of
            the root of the box's area.
        mask_std_px: least error of a mask's edge, in pixels of the image.
        mask_spread: error of a mask's edge in cells of the mask.
        depth_noise_per_m: standard deviation of the depth in metres at 1 m; at z metres it is
            z² times that, as with stereo. What the readings of a stem scatter replaces it where
            there are many.
        depth_noise_m: the least standard deviation of the depth, as time-of-flight cameras have it.
        depth_bias_per_m: what all depth on one stem is off by together, in metres at 1 m; at z
            metres it is z² times that. Steps of the disparity do it.
        depth_correlation_px: depth within squares of so many pixels has one error.
        outline_doubt: how far a diameter is doubted, as a share of it, for what its mask does not
            show: times the square of the share of stations along the stem without both edges.
        depth_doubt: the same for contradictory depth: times the square of the share of readings
            that disagree with the stem.
        arc_doubt: the same for depth on one side only: times the share of the visible round
            without a reading. All three together count at most 0.3.
        butt_swell: how much thicker a stem is at the cut than where it shows lowest, as a share,
            where the cut is below the picture; and butt_swell_std how far stems differ in that.
        out_of_round_std: how far the diameter of a real stem differs with the side it is seen
            from and the height, as a share of it.
        curvature_std: how far the roundness of what the depth sees of a stem can be trusted to
            tell its diameter, as a share of it.
        bend_std_deg: how far the axis of a real stem turns along it.
        lean_std_deg: how far stems lean from the vertical, before looking.
        breast_height_m: where the second diameter is measured, above the ground on the uphill
            side, along the vertical.
        max_stump_height_m: felling cuts higher above the ground are warned of.
        max_range_m: depth beyond it is not used.
        max_diameter_m: stems that seem thicker are refused.
        max_slope_deg: ground that seems steeper is refused.

    Raises:
        InputError: a value is not a positive number.
    """

    keypoint_std_px: float = 1.0
    keypoint_spread: float = 0.009
    keypoint_slide: float = 0.02
    mask_std_px: float = 2.0
    mask_spread: float = 0.3
    depth_noise_per_m: float = 0.002
    depth_noise_m: float = 0.005
    depth_bias_per_m: float = 0.0005
    depth_correlation_px: float = 6.0
    outline_doubt: float = 0.4
    depth_doubt: float = 1.1
    arc_doubt: float = 0.85
    butt_swell: float = 0.14
    butt_swell_std: float = 0.08
    out_of_round_std: float = 0.0115
    curvature_std: float = 0.1
    bend_std_deg: float = 0.85
    lean_std_deg: float = 6.0
    breast_height_m: float = 1.3
    max_stump_height_m: float = 0.3
    max_range_m: float = 25.0
    max_diameter_m: float = 2.5
    max_slope_deg: float = 45.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{field.name} is {value}: expected a positive number")
