"""Half the viewing angle of stems, from keypoints and mask edges, and the fusion of sources."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float, Index
from calib import PinholeCamera
from edgetree.measure.constants.stems import SHAPE_STD_PER_M, SWELL_LENGTH_M, VISIBLE_WITHIN_M
from edgetree.measure.edge_lines import fit_lines
from edgetree.measure.section import Sections, StemAxes

# The width at a height is read from mask edges with Gaussian weights of this standard deviation.
# Edges further away keep a small weight, for stems with few edges.
_WINDOW_M = 0.2
_FAR_WEIGHT = 1e-3


class HalfAngle(NamedTuple):
    """Half angles of T stems from one source.

    Attributes:
        rad: (T,) half the angle between the two rays that touch the stem.
        std_rad: (T,) standard deviations; infinite where the source gives no value.
    """

    rad: Float
    std_rad: Float


@dataclass(frozen=True, eq=False)
class MaskWidths:
    """Edges of T stems in their masks, as angles around the camera.

    Attributes:
        height_m: (T, S) heights of the stations along the axis, from the section.
        bearing_rad: (2, T, S) bearings of the left and right edges; 0 where they are not visible.
        valid: (2, T, S) stations at which the edge is visible.
        std_rad: (T,) standard deviation of a half angle.
    """

    height_m: Float
    bearing_rad: Float
    valid: Bool
    std_rad: Float

    def at(self, height_m: Float) -> tuple[HalfAngle, Float]:
        """Half angles and bearings of the middle, by local linear fits to the edges.

        Args:
            height_m: (T,) heights along the axis, from the section.

        Returns:
            The half angles, and (T,) bearings of the middle in radians.
        """
        offset = self.height_m - height_m[:, None]
        nearness = np.exp(-0.5 * (offset / _WINDOW_M) ** 2) + _FAR_WEIGHT / (1 + offset**2)
        weight = np.where(self.valid, nearness, 0.0)
        left, right = fit_lines(offset, self.bearing_rad, weight)[0]
        away_m = np.vecdot(weight, np.abs(offset)) / np.maximum(weight.sum(2), 1e-12)
        half = (right - left) / 2
        std = np.hypot(self.std_rad, SHAPE_STD_PER_M * away_m.max(0) * half)
        known = self.valid.any(2).all(0) & (half > 0)
        return HalfAngle(half, np.where(known, std, np.inf)), (left + right) / 2

    def below_edges(self) -> Float:
        """(T,) share of the butt swell between the lowest edges and the section, from 0 to 1."""
        lowest_m = np.where(self.valid, self.height_m, np.inf).min(2)
        shares = 1 - np.exp(-np.maximum(lowest_m, 0.0) / SWELL_LENGTH_M)
        return np.asarray(shares.mean(0))

    def middle_m(self) -> Float:
        """(T,) middle of the heights at which either edge shows; 0 where none does."""
        number = self.valid.sum((0, 2))
        return np.asarray(
            np.where(self.valid, self.height_m, 0.0).sum((0, 2)) / np.maximum(number, 1)
        )

    def lowest_m(self) -> Float:
        """(T,) lowest heights at which both edges are visible; infinite where there are none."""
        return np.asarray(np.where(self.valid.all(0), self.height_m, np.inf).min(1))

    def visible_at(self, height_m: Float) -> Bool:
        """(T,) whether both edges are visible near heights (T,) along the axis."""
        near = np.abs(self.height_m - height_m[:, None]) < VISIBLE_WITHIN_M
        return np.asarray((near & self.valid).any(2).all(0))

    def select(self, rows: Index) -> MaskWidths:
        """The edges of some stems, in this order."""
        return MaskWidths(
            self.height_m[rows], self.bearing_rad[:, rows], self.valid[:, rows], self.std_rad[rows]
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class StemEdges:
    """The edges of T stems as viewing rays with z = 1, from keypoints and from masks.

    Attributes:
        camera: Camera of the rays.
        section: (T, 2, 3) rays to the left and right edge of the section, by keypoints. Where
            there are none, both are the ray to the middle of the section to be measured.
        section_std_px: (T,) standard deviation of one of them across the stem; infinite where
            there are none.
        sides: (2, T, S, 3) rays to the left and right edges at the stations, by masks.
        valid: (2, T, S) which of these are valid.
        mask_std_px: (T,) standard deviation of one of them.
        distance_m: (T,) approximate distance to the axis.
        butt_swell, butt_swell_std: (T,) relative difference between the diameter at the section and
            that of the stem well above it, where the section is at the butt, and its standard
            deviation. See `MeasureSettings.butt_swell`.
    """

    camera: PinholeCamera
    section: Float
    section_std_px: Float
    sides: Float
    valid: Bool
    mask_std_px: Float
    distance_m: Float
    butt_swell: Float
    butt_swell_std: Float

    @cached_property
    def middle(self) -> Float:
        """(T, 3) rays to the middle of the sections."""
        return np.asarray(self.section.mean(1))

    @cached_property
    def _both(self) -> Bool:
        """(T, S) stations at which both edges are valid."""
        return np.asarray(self.valid.all(0))

    @cached_property
    def _side_shares(self) -> Float:
        """(2, T, S) shares of the edges in the heights of the stations: those of valid edges."""
        shown = self.valid.sum(0)
        return np.where(shown, self.valid / np.maximum(shown, 1), 0.5)

    def sections(
        self, axes: StemAxes, half_rad: Float | None = None
    ) -> tuple[Sections, list[HalfAngle], MaskWidths]:
        """Cross-sections of the stems.

        Args:
            axes: Coordinate systems of the stems.
            half_rad: (T,) half angles, if known better than from these edges.

        Returns:
            The cross-sections, the half angles from keypoints and from masks, and the edges of the
            masks by height.
        """
        bearing, slope = axes.bearing_and_slope(self.section)
        rad_per_px = self._rad_per_px(axes)
        # Half the difference of two edges with independent errors.
        std_rad = self.section_std_px * rad_per_px / np.sqrt(2)
        keypoints = HalfAngle(np.abs(bearing[:, 1] - bearing[:, 0]) / 2, std_rad)
        slope = slope.mean(1)
        widths = self._mask_widths(axes, slope * np.cos(keypoints.rad), rad_per_px)
        mask, mask_middle = self._at_section(widths)
        sources = [keypoints, mask]
        fused, weights = fuse(sources)
        half = fused.rad if half_rad is None else half_rad
        middle = weights[0] * bearing.mean(1) + weights[1] * mask_middle
        # The tangent points are at d cos(delta) from the camera and in the plane of the section.
        return Sections(axes, middle, half, slope * np.cos(half)), sources, widths

    def _at_section(self, widths: MaskWidths) -> tuple[HalfAngle, Float]:
        """Half angles and bearings of the middle at the sections, by the mask edges.

        Where the lowest edges are above the section, the butt swell between them is added.
        """
        half, middle = widths.at(np.zeros(len(widths.height_m)))
        share = widths.below_edges()
        std = np.hypot(half.std_rad, self.butt_swell_std * share * half.rad)
        return HalfAngle(half.rad * (1 + self.butt_swell * share), std), middle

    def mask_widths(self, axes: StemAxes, section_height_ratio: Float) -> MaskWidths:
        """The mask edges by height along the axis.

        Args:
            axes: Coordinate systems of the stems.
            section_height_ratio: (T,) heights of the sections, see `Sections.height_ratio`.
        """
        return self._mask_widths(axes, section_height_ratio, self._rad_per_px(axes))

    def _mask_widths(
        self, axes: StemAxes, section_height_ratio: Float, rad_per_px: Float
    ) -> MaskWidths:
        bearing, slope = axes.bearing_and_slope(self.sides)
        # A station of which one edge shows has the height of that edge.
        both, number = self._both, np.maximum(self._both.sum(1, keepdims=True), 1)
        slope = (self._side_shares * slope).sum(0)
        narrowing = np.where(both, np.cos((bearing[1] - bearing[0]) / 2), 0.0)
        usual = narrowing.sum(1, keepdims=True) / number
        usual = np.where(usual > 0, usual, 1.0)
        height_ratio = slope * np.where(both, narrowing, usual) - section_height_ratio[:, None]
        return MaskWidths(
            height_m=height_ratio * self.distance_m[:, None],
            bearing_rad=np.where(self.valid, bearing, 0.0),
            valid=self.valid,
            std_rad=self.mask_std_px * rad_per_px / np.sqrt(2),
        )

    def _rad_per_px(self, axes: StemAxes) -> Float:
        """(T,) change of an edge's bearing per pixel across the stem."""
        reach = np.hypot(np.vecdot(self.middle, axes.across), np.vecdot(self.middle, axes.away))
        pixel = np.hypot(axes.across[:, 0] / self.camera.fx, axes.across[:, 1] / self.camera.fy)
        return np.asarray(pixel / reach)


def fuse(sources: list[HalfAngle]) -> tuple[HalfAngle, Float]:
    """Combine half angles by inverse variance weighting.

    If the sources disagree by more than their standard deviations allow, the result's standard
    deviation is multiplied by the Birge ratio, the square root of the reduced chi-squared
    (Birge 1932, The calculation of errors by the method of least squares).

    Args:
        sources: Half angles; those with an infinite standard deviation are ignored.

    Returns:
        The weighted mean, with an infinite standard deviation where there is no source, and
        (sources, T) the weights, which add up to 1.
    """
    values = np.array([source.rad for source in sources])
    information = 1 / np.array([source.std_rad for source in sources]) ** 2
    given = information > 0
    values = np.where(given, values, 0.0)
    number = given.sum(0)
    known = number > 0
    total = np.where(known, information.sum(0), 1.0)
    weights = information / total
    mean = np.asarray((weights * values).sum(0))
    chi_squared = (information * (values - mean) ** 2).sum(0)
    birge_ratio = np.sqrt(np.maximum(1.0, chi_squared / np.maximum(number - 1, 1)))
    return HalfAngle(mean, np.where(known, birge_ratio / np.sqrt(total), np.inf)), weights
