"""How the edges of stems converge along them, which tells their tilt without any depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from basetree.arrays import Float
from edgetree.measure.constants.outlines import STATIONS_PER_ERROR
from edgetree.measure.constants.stems import (
    TAPER_PER_M,
    TAPER_SPREAD_PER_M,
    TAPER_STD_PER_M,
)
from edgetree.measure.edge_lines import fit_lines
from edgetree.measure.width import MaskWidths

# Edges at fewer stations tell no tilt.
_MIN_STATIONS = 4
# Least inverse distance, 1/m, and least share of a taper by which edges and bark differ.
_MIN_INVERSE, _MIN_APART = 1e-3, 0.2


@dataclass(frozen=True, eq=False)
class Convergence:
    """Straight lines of half angle over height along T stems.

    A stem that leans towards the camera is nearer at its top, and its edges are further apart
    there than the taper allows.

    Attributes:
        height_ratio: (T,) mean height of the edges above the section, per metre of distance.
        half_rad: (T,) half angle there.
        slope: (T,) change of the half angle per unit of that height.
        half_std, slope_std: (T,) their standard deviations, which are independent; infinite where
            too few edges are seen.
    """

    height_ratio: Float
    half_rad: Float
    slope: Float
    half_std: Float
    slope_std: Float

    @classmethod
    def of(cls, widths: MaskWidths, distance_m: Float) -> Convergence:
        """The lines through the edges in the masks.

        Args:
            widths: Edges of T stems, by height from the section.
            distance_m: (T,) distance by which these heights were scaled.
        """
        left, right = widths.bearing_rad
        half = (right - left) / 2
        weight = (widths.valid.all(0) & (half > 0)).astype(np.float64)
        count = weight.sum(1)
        height = widths.height_m / distance_m[:, None]
        mean = np.vecdot(weight, height) / np.maximum(count, 1.0)
        value, slope = fit_lines(height - mean[:, None], half, weight)
        spread = np.vecdot(weight, (height - mean[:, None]) ** 2)
        std = widths.std_rad * np.sqrt(STATIONS_PER_ERROR)
        known = (count >= _MIN_STATIONS) & (spread > 0)
        return cls(
            height_ratio=mean,
            half_rad=value,
            slope=slope,
            half_std=np.where(known, std / np.sqrt(np.maximum(count, 1.0)), np.inf),
            slope_std=np.where(known, std / np.sqrt(np.where(known, spread, 1.0)), np.inf),
        )

    def squared_misfit(self, value: Float, slope: Float) -> Float:
        """(T, ...) squared distance of the edges from lines of inverse distance, in variances.

        The half angle is as the radius times the inverse distance, so their relative changes with
        the height differ by the taper alone.

        Args:
            value, slope: (T, ...) the lines at the section, and their change with the height ratio.
        """
        height, half, change, half_std, change_std = (
            part.reshape(-1, *(1,) * (value.ndim - 1))
            for part in (
                self.height_ratio,
                self.half_rad,
                self.slope,
                self.half_std,
                self.slope_std,
            )
        )
        inverse = np.maximum(value + slope * height, _MIN_INVERSE)
        relative = (slope - TAPER_PER_M) / inverse
        taper_std = TAPER_STD_PER_M / inverse * half
        variance = change_std**2 + (relative * half_std) ** 2 + taper_std**2
        return np.asarray((change - relative * half) ** 2 / variance)

    def taper_per_m(self, value: Float, slope: Float, receding: Float) -> Float:
        """(T,) relative decreases of the diameter per metre.

        The means of `TAPER_PER_M` and what the edges show, by their inverse variances.

        Args:
            value, slope: (T,) lines of the bark's inverse distance, as in `squared_misfit`.
            receding: (T,) by how much a taper of 1 per metre makes their slope smaller than that
                of the axis.
        """
        inverse = np.maximum(value + slope * self.height_ratio, _MIN_INVERSE)
        tangent = np.tan(np.maximum(self.half_rad, 1e-6))
        relative = self.slope / tangent
        apart = np.maximum(1 - receding, _MIN_APART)
        std = np.hypot(self.slope_std, relative * self.half_std) / tangent * inverse / apart
        seen = (slope - relative * inverse) / apart
        share = 1 / (1 + (std / TAPER_SPREAD_PER_M) ** 2)
        return np.asarray(TAPER_PER_M + share * (seen - TAPER_PER_M))
