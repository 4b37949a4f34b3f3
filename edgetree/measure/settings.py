"""Assumptions of the measurement about sensor, model and forest."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from basetree.arrays import Float
from basetree.errors import InputError
from edgetree.measure.constants.edges import NETWORK_EDGE_PX
from edgetree.measure.volume import EXPECTED_SPECIES, SPECIES, Species

_REFERENCE_WIDTH_PX = 1280
# Of laser scanners, chosen after what their makers commonly state: 1 to 3 cm at one standard
# deviation, nearly the same at all distances; each beam is a measurement of its own. What all beams
# share is as large again, with a centimetre along each axis of the transform to the camera.
_BEAM_ERRORS = {
    "depth_noise_per_m": 1e-4,
    "depth_noise_m": 0.02,
    "depth_bias_per_m": 1e-4,
    "depth_bias_m": 0.015,
    "depth_correlation_px": 1.0,
}
_DETECTOR_ERRORS = (
    "keypoint_std_px",
    "keypoint_spread",
    "keypoint_slide",
    "keypoint_heat",
    "keypoint_heat_slide",
    "mask_std_px",
    "mask_spread",
)

_MAY_BE_0 = ("ground_cover_m", "ground_cover_std_m")


def reference_px(image_width: int) -> float:
    """Pixels of an image that are as wide as one pixel of an image of 1280 px width."""
    return image_width / _REFERENCE_WIDTH_PX


def network_std_px(std_px: float, image_width: int, side_px: int = 1) -> float:
    """Standard deviation in px of the image, of one in px of an image of 1280 px width.

    A network sees every image at its own input size, so its errors are shares of the width. But
    where it sees an edge depends on the pixels of the image, too: the least is `NETWORK_EDGE_PX`,
    or `std_px` if that is smaller.

    Args:
        std_px: Standard deviation in px of an image of 1280 px width.
        image_width: Width of the image in px.
        side_px: Side of the squares of pixels that share one reading.
    """
    return max(std_px * reference_px(image_width), min(std_px, NETWORK_EDGE_PX * side_px))


@dataclass(frozen=True)
class MeasureSettings:
    """Assumptions of `measure_trees`. All numbers are positive, and those of the ground's
    cover may be 0.

    "Standard deviation" is a one-sigma error. Fractions are between 0 and 1.

    Attributes:
        keypoint_std_px: Smallest standard deviation of a keypoint, in pixels of an image of
            1280 px width. In other images it is the same share of the width.
        keypoint_spread: Standard deviation of a keypoint across the stem at score 1, as a
            fraction of the box width. It grows with 1 / sqrt(score), because a normal heat map
            of standard deviation s has the peak 1 / (2 pi s²).
        keypoint_slide: The same along the stem, where no edge limits the heat map, as a fraction
            of the square root of the box area.
        keypoint_heat: Standard deviation of a keypoint, as a share of that of its heat map. For
            models that give the latter it takes the place of the two above.
        keypoint_heat_slide: The same down the image, along the stem, where no edge limits the heat
            map.
        mask_std_px: Smallest standard deviation of a mask edge, in the same pixels.
        mask_spread: Standard deviation of a mask edge, in cells of the mask grid.
        given_mask_std_px: The same for masks of the image's size that the caller gives, instead of
            the two above, in pixels of the image. The scatter of each outline about straight
            lines adds to it.
        depth_noise_per_m: Standard deviation of the depth at 1 m, in metres. At z metres it is
            z² times as large, as for stereo cameras. It is adjusted to the scatter of the
            readings on a stem where there are many.
        depth_noise_m: Smallest standard deviation of the depth in metres, as for time-of-flight
            cameras.
        depth_bias_per_m: Error that all depth readings on one stem share, for example from the
            steps of the disparity, at 1 m, in metres. At z metres it is z² times as large.
        depth_bias_m: The same at all distances, as of laser scanners, whose place beside the camera
            is part of it.
        depth_correlation_px: Side of the image squares in which all depth readings share one
            error, in pixels.
        outline_doubt: Relative standard deviation that is added to a diameter for missing mask
            edges: this value times the fourth power of the share of stations along the stem
            without an edge, on the side that shows fewer.
        readings_doubt: The same for missing or contradictory depth: this value times the square of
            the share of the samples within the outline that give no reading on the fitted stem.
            Both together are limited to 0.45. For masks that the caller gives, 0.3 of both is
            added, because they do not depend on a detector.
        butt_swell: Relative difference between the diameter at the cut and that of the stem well
            above it. It is added where the cut is below the image, and as far as the lowest edges
            of a mask are above the section.
        butt_swell_std: Standard deviation of `butt_swell` between stems.
        out_of_round_std: Relative standard deviation of a real stem's width with viewing
            direction and height, about its girth divided by pi. A section whose axes have the ratio
            1 + a has a / 2.8: the default stands for axes that differ by 6 % in the square mean.
        curvature_std: Relative standard deviation of the diameter from the curvature of the depth
            across the stem.
        bend_std_deg: Standard deviation of the axis direction along a real stem, in degrees.
        lean_std_deg: Standard deviation of a stem's lean before it is measured, in degrees.
        breast_height_m: Height of the second diameter above the ground on the uphill side, along
            the vertical, in metres.
        max_stump_height_m: Felling cuts higher above the ground give a warning, in metres.
        max_range_m: Depth readings beyond this are not used, in metres.
        max_diameter_m: Larger diameters are reported as failures, in metres.
        max_slope_deg: Steeper ground is rejected, in degrees.
        ground_cover_m: Mean height of snow, moss or plants with an even top that hide the ground,
            in metres, as measured by hand. Heights count from the ground below it.
        ground_cover_std_m: Standard deviation of this height from stem to stem, in metres.
        species: Species of the function for the volume of whole stems: "pine", "spruce" or
            "birch". None gives no such volume.

    Raises:
        InputError: a number is not positive, or of the ground's cover negative, or the species is
            unknown.
    """

    keypoint_std_px: float = 1.05
    keypoint_spread: float = 0.008
    keypoint_slide: float = 0.02
    keypoint_heat: float = 0.9
    keypoint_heat_slide: float = 1.25
    mask_std_px: float = 1.3
    mask_spread: float = 0.2
    given_mask_std_px: float = 1.1
    depth_noise_per_m: float = 0.002
    depth_noise_m: float = 0.005
    depth_bias_per_m: float = 0.0005
    depth_bias_m: float = 1e-6
    depth_correlation_px: float = 6.0
    outline_doubt: float = 0.5
    readings_doubt: float = 1.2
    butt_swell: float = 0.14
    butt_swell_std: float = 0.08
    out_of_round_std: float = 0.02
    curvature_std: float = 0.05
    bend_std_deg: float = 0.5
    lean_std_deg: float = 6.0
    breast_height_m: float = 1.3
    max_stump_height_m: float = 0.3
    max_range_m: float = 25.0
    max_diameter_m: float = 2.5
    max_slope_deg: float = 45.0
    ground_cover_m: float = 0.0
    ground_cover_std_m: float = 0.0
    species: Species | None = None

    def __post_init__(self) -> None:
        if self.species not in (None, *SPECIES):
            raise InputError(f"species is {self.species!r}: expected {EXPECTED_SPECIES}")
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "species":
                continue
            if field.name in _MAY_BE_0 and math.isfinite(value) and value >= 0:
                continue
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{field.name} is {value}: expected a positive number")

    def scaled(self, factor: float) -> MeasureSettings:
        """The same with `factor` times the errors of a detector's keypoints and mask edges."""
        if factor == 1:
            return self
        return replace(self, **{name: factor * getattr(self, name) for name in _DETECTOR_ERRORS})

    def depth_stds_m(self, depth_m: Float) -> Float:
        """Assumed standard deviations of depth readings (...) in metres, of the same shape."""
        # `np.hypot` takes several times as long.
        variance = self.depth_noise_m**2 + (self.depth_noise_per_m * depth_m**2) ** 2
        return np.asarray(np.sqrt(variance))

    def of_beams(self) -> MeasureSettings:
        """The same with the depth's noise of a laser scanner, where it is not given."""
        usual = MeasureSettings()
        unset = {name for name in _BEAM_ERRORS if getattr(self, name) == getattr(usual, name)}
        changes: dict[str, Any] = {name: _BEAM_ERRORS[name] for name in unset}
        return replace(self, **changes)
