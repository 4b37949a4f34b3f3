"""Half the angle that a stem fills: from keypoints, from the mask's edges, and all fused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera
from edgetree.measure.outline import weighted_lines
from edgetree.measure.section import AxisFrames, Sections

__all__ = ["HalfAngle", "MaskWidths", "StemEdges", "fuse"]

Float = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]

# The mask's width at a height is read off its edges this far around; where there are few, from
# further away, and the worse the further.
_WINDOW_M = 0.2
_FAR_WEIGHT = 1e-3
_SHAPE_PER_M = 0.05
_SEEN_M = 0.25


class HalfAngle(NamedTuple):
    """One source's half angles and their standard deviations, (T,) radians.

    Where the source says nothing the deviation is infinite.
    """

    rad: Float
    std_rad: Float


@dataclass(frozen=True, eq=False)
class MaskWidths:
    """What the masks show of the stems' widths.

    Attributes:
        height_m: (T, S) of the stations along the axis.
        left_rad, right_rad: (T, S) bearings of the edges.
        left_valid, right_valid: (T, S) stations where they show.
        std_rad: (T,) standard deviation of a half angle, the same along a stem.
    """

    height_m: Float
    left_rad: Float
    right_rad: Float
    left_valid: Flags
    right_valid: Flags
    std_rad: Float

    def at(self, height_m: Float) -> tuple[HalfAngle, Float]:
        """Half angles and middle bearings (T,) at heights (T,) along the axis."""
        offset = self.height_m - height_m[:, None]
        nearness = np.exp(-0.5 * (offset / _WINDOW_M) ** 2) + _FAR_WEIGHT / (1 + offset**2)
        valid = np.concatenate([self.left_valid, self.right_valid])
        bearing = np.where(valid, np.concatenate([self.left_rad, self.right_rad]), 0.0)
        offset = np.concatenate([offset, offset])
        weight = np.where(valid, np.concatenate([nearness, nearness]), 0.0)
        left, right = weighted_lines(offset, bearing, weight)[0].reshape(2, -1)
        support_m = (weight * np.abs(offset)).sum(1) / np.maximum(weight.sum(1), 1e-12)
        half, away_m = (right - left) / 2, support_m.reshape(2, -1).max(0)
        std = np.hypot(self.std_rad, _SHAPE_PER_M * away_m * half)
        known = self.left_valid.any(1) & self.right_valid.any(1) & (half > 0)
        return HalfAngle(half, np.where(known, std, np.inf)), (left + right) / 2

    def seen_at(self, height_m: Float) -> Flags:
        """(T,) whether both edges show near heights (T,) along the axis."""
        near = np.abs(self.height_m - height_m[:, None]) < _SEEN_M
        return np.asarray((near & self.left_valid).any(1) & (near & self.right_valid).any(1))


@dataclass(frozen=True, eq=False)
class StemEdges:
    """The edges of T stems as rays, from keypoints and from masks.

    Attributes:
        camera: the camera of the rays.
        section: (T, 2, 3) rays that graze the section left and right; where there are none, twice
            the ray to the middle of where the section shall be.
        section_std_px: (T,) error of one of them across; infinite where there are none.
        left, right: (T, S, 3) rays that graze the stems at their stations, by the masks.
        left_valid, right_valid: (T, S) which of these there are.
        mask_std_px: (T,) error of one of them.
        distance_m: (T,) roughly, to the axis.
    """

    camera: PinholeCamera
    section: Float
    section_std_px: Float
    left: Float
    right: Float
    left_valid: Flags
    right_valid: Flags
    mask_std_px: Float
    distance_m: Float

    def sections(
        self, frames: AxisFrames, half_rad: Float | None = None
    ) -> tuple[Sections, list[HalfAngle]]:
        """The sections across the axes of these frames, with half angles (T,) where they are
        known better than from these edges, which are given too: by keypoints, by masks.
        """
        bearing = frames.bearing_rad(self.section)
        keypoints = HalfAngle(np.abs(bearing[:, 1] - bearing[:, 0]) / 2, self._std_rad(frames))
        slope = frames.slope(self.section).mean(1)
        widths = self.mask_widths(frames, slope * np.cos(keypoints.rad))
        mask, mask_middle = widths.at(np.zeros(len(slope)))
        sources = [keypoints, mask]
        fused, shares = fuse(sources)
        half = fused.rad if half_rad is None else half_rad
        middle = shares[:, 0] * bearing.mean(1) + shares[:, 1] * mask_middle
        # The tangent points lie at d cos(delta), and both on the section.
        return Sections(frames, middle, half, slope * np.cos(half)), sources

    def mask_widths(self, frames: AxisFrames, section_height: Float) -> MaskWidths:
        """What the masks show, by metres along these axes from the sections."""
        left, right = frames.bearing_rad(self.left), frames.bearing_rad(self.right)
        slope = (frames.slope(self.left) + frames.slope(self.right)) / 2
        height = slope * np.cos((right - left) / 2) - section_height[:, None]
        std_rad = self.mask_std_px * self._pixel_rad(frames) / np.sqrt(2)
        return MaskWidths(
            height * self.distance_m[:, None],
            left,
            right,
            self.left_valid,
            self.right_valid,
            std_rad,
        )

    def _std_rad(self, frames: AxisFrames) -> Float:
        return np.asarray(self.section_std_px * self._pixel_rad(frames) / np.sqrt(2))

    def _pixel_rad(self, frames: AxisFrames) -> Float:
        """(T,) how far one pixel turns an edge of the stem around the camera, across the axis."""
        middle = self.section.mean(1)
        reach = np.hypot((middle * frames.across).sum(1), (middle * frames.away).sum(1))
        pixel = np.hypot(frames.across[:, 0] / self.camera.fx, frames.across[:, 1] / self.camera.fy)
        return np.asarray(pixel / reach)


def fuse(sources: list[HalfAngle]) -> tuple[HalfAngle, Float]:
    """The mean of sources by their uncertainty, from whichever there are.

    Sources that disagree by more than they state make the mean as uncertain as their spread
    (Birge's ratio). Where there is no source at all the deviation is infinite.

    Returns:
        The mean, and (T, sources) the share of each in it.
    """
    values = np.stack([source.rad for source in sources], -1)
    weights = np.stack([1 / source.std_rad**2 for source in sources], -1)
    values = np.where(weights > 0, values, 0.0)
    total = weights.sum(-1)
    known = total > 0
    share = weights / np.where(known, total, 1.0)[:, None]
    mean = (share * values).sum(-1)
    spread = (weights * (values - mean[:, None]) ** 2).sum(-1)
    birge = np.sqrt(np.maximum(1.0, spread / np.maximum((weights > 0).sum(-1) - 1, 1)))
    std = np.where(known, birge / np.sqrt(np.where(known, total, 1.0)), np.inf)
    return HalfAngle(mean, std), share
