"""Diameters along one stem, as a result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from basetree.arrays import Float

HeightsFrom: TypeAlias = Literal["ground", "section"]

_DIGITS = 5


@dataclass(frozen=True, eq=False, kw_only=True)
class StemProfile:
    """Diameters of a stem at every 10 cm where both its edges are seen. Always true.

    The errors of all diameters of one stem have mostly the same causes: the distance, the mask and
    the shape of the stem. Averaging diameters therefore makes them hardly more accurate.

    Attributes:
        heights_from: "ground": heights are above the ground on the uphill side, along the
            vertical, as the cut height. "section": there is no ground to see, and heights are
            along the axis from where the diameter is measured.
        height_m: (N,) heights in metres, ascending. N is at least 2.
        diameter_m: (N,) diameters at right angles to the axis, in metres.
        diameter_std_m: (N,) their standard deviations.
        edges_m: (N, 2, 3) points at the left and the right edge, in camera coordinates.
    """

    heights_from: HeightsFrom
    height_m: Float
    diameter_m: Float
    diameter_std_m: Float
    edges_m: Float

    def __bool__(self) -> Literal[True]:
        return True

    def to_dict(self) -> dict[str, str | list[float]]:
        """A JSON-ready dictionary without the edges; numbers are rounded to 0.01 mm."""
        return {
            "heights_from": self.heights_from,
            "height_m": self.height_m.round(_DIGITS).tolist(),
            "diameter_m": self.diameter_m.round(_DIGITS).tolist(),
            "diameter_std_m": self.diameter_std_m.round(_DIGITS).tolist(),
        }
