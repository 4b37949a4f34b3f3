"""Straight regions of the image in which the edges of stems are searched for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from basetree.arrays import Bool, Float, Index

STATIONS = 24
"""Number of cross-lines along every stem, at which its edges and depth are sampled.

It is a multiple of four, because lines are searched for in halves and quarters of a stem.
"""

OUTWARDS = np.array([-1.0, 1.0])[:, None, None]
"""Direction across a region in which the left and the right edge face away from the stem."""

MIN_HALF_PX = 0.5
"""Smallest half width of a region, so that samples across it differ."""


@dataclass(frozen=True, eq=False)
class SearchRegions:
    """Straight regions of the image around T stems, in which their edges are searched for.

    Attributes:
        origin_px: (T, 2) a point on the region's centre line.
        along: (T, 2) unit vector of the centre line, up the stem.
        half_px: (T,) half the width.
        span_px: (T, 2) lowest and highest position along the centre line, from the origin.
    """

    origin_px: Float
    along: Float
    half_px: Float
    span_px: Float

    @cached_property
    def across(self) -> Float:
        """(T, 2) unit vector at right angles to the centre line, to the right of the stem."""
        return np.stack([-self.along[:, 1], self.along[:, 0]], -1)

    @cached_property
    def _across(self) -> Float:
        """(2, T, 1, 1) x and y of `across`."""
        return self.across.T[..., None, None]

    def of(self, stems: Bool | Index) -> SearchRegions:
        """The regions of some of the stems, chosen by flags (T,) or their numbers."""
        return SearchRegions(*(part[stems] for part in self.arrays))

    @property
    def arrays(self) -> tuple[Float, Float, Float, Float]:
        """All arrays, in the order of the attributes."""
        return self.origin_px, self.along, self.half_px, self.span_px

    @cached_property
    def stations_px(self) -> Float:
        """(T, S) evenly spaced positions along the centre line, from low to high."""
        fraction = (np.arange(STATIONS) + 0.5) / STATIONS
        low, high = self.span_px[:, :1], self.span_px[:, 1:]
        return np.asarray(low + (high - low) * fraction)

    @cached_property
    def _line_px(self) -> Float:
        """(2, T, S, 1) x and y of the stations on the centre line."""
        origin_px, along = self.origin_px.T[..., None], self.along.T[..., None]
        return np.asarray(origin_px + self.stations_px * along)[..., None]

    def points(self, across_px: Float) -> Float:
        """Image points at the stations.

        Args:
            across_px: (..., T, S, C) offsets from the centre line, positive to the right.

        Returns:
            (..., T, S, C, 2) points in pixels; in memory, all x lie before all y.
        """
        by_axis = (slice(None), *(None,) * (across_px.ndim - 3))
        points = np.multiply(across_px, self._across[by_axis], order="C")
        points += self._line_px[by_axis]
        return points.transpose(*range(1, points.ndim), 0)


def line_spans(origin_px: Float, along: Float, boxes_px: Float) -> Float:
    """Where lines leave their boxes.

    Args:
        origin_px: (T, 2) points on the lines.
        along: (T, 2) unit vectors of the lines.
        boxes_px: (T, 4) boxes x0, y0, x1, y1.

    Returns:
        (T, 2) positions along each line, from its origin: against its direction and in it.
    """
    safe = np.where(np.abs(along) < 1e-6, 1e-6, along)
    ends = (boxes_px.reshape(-1, 2, 2) - origin_px[:, None]) / safe[:, None]
    low, high = np.sort(ends, axis=1).transpose(1, 0, 2)
    return np.stack([low.max(1), high.min(1)], -1)
