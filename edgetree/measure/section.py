"""Geometry of cylinders seen from a nearby camera, in the plane across their axes.

In the plane at right angles to the stem's axis, the stem is a circle, the camera a point and each
viewing ray a direction. Let `d` be the distance from the camera to the axis in that plane and
`delta` half the angle between the two rays that touch the circle. From the right triangle of
camera, tangent point and centre follows:

- The radius is `d sin(delta)`.
- A ray at angle `theta` from the centre meets the front of the circle at the range
  `d (cos(theta) - sqrt(sin²(delta) - sin²(theta)))`, the smaller root of the quadratic equation
  for the intersection of a line with a circle.
- At the centre this is the front range `rho = d (1 - sin(delta))`, so the diameter is
  `2 rho sin(delta) / (1 - sin(delta))`.

All functions work on T stems at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from basetree.arrays import Float
from calib.directions import unit

# Close to the edge, the depth changes without bound with the angle. Readings at a larger offset
# than this (1 at the edge) are not used.
_MAX_OFFSET = 0.995


def _dot(vectors: Float, axes: Float) -> Float:
    """(..., T, N) dot products of (..., T, N, 3) vectors with one (T, 3) axis per stem."""
    return np.asarray(np.matmul(vectors, axes[..., None])[..., 0])


@dataclass(frozen=True, eq=False)
class StemAxes:
    """An orthonormal coordinate system for each of T stems, in camera coordinates.

    Attributes:
        along: (T, 3) unit vectors along the stem's axis, upwards.
        across: (T, 3) unit vectors at right angles to the axis, to the right in the image.
        away: (T, 3) unit vectors at right angles to both, away from the camera.
    """

    along: Float
    across: Float
    away: Float

    @classmethod
    def joined(cls, parts: Sequence[StemAxes]) -> StemAxes:
        """The systems of all stems of some parts, one after the other."""
        return cls(
            np.concatenate([part.along for part in parts]),
            np.concatenate([part.across for part in parts]),
            np.concatenate([part.away for part in parts]),
        )

    def mapped(self, to_axes: Callable[[Float], Float]) -> StemAxes:
        """The same systems with their vectors in other axes."""
        return StemAxes(to_axes(self.along), to_axes(self.across), to_axes(self.away))

    def tilted(self, tangent: Float) -> StemAxes:
        """The same systems with each axis tilted away from the camera.

        Args:
            tangent: (T,) tangents of the tilt angles.
        """
        tangent = tangent[:, None]
        length = np.hypot(1.0, tangent)
        return StemAxes(
            (self.along + tangent * self.away) / length,
            self.across,
            (self.away - tangent * self.along) / length,
        )

    def bearing_and_slope(self, rays: Float) -> tuple[Float, Float]:
        """Directions of viewing rays.

        Args:
            rays: (..., T, N, 3) rays.

        Returns:
            (..., T, N) their bearings, which are angles around the axis in radians, 0 at `away` and
            positive to `across`, and (..., T, N) metres along the axis per metre across it.
        """
        along, across, away = (_dot(rays, axis) for axis in (self.along, self.across, self.away))
        return np.arctan2(across, away), along / np.hypot(across, away)


def fit_axes(rays: Float, std_rad: Float, up: Float, lean_std_rad: float) -> tuple[StemAxes, Float]:
    """Fit the plane through the camera that holds each stem's axis.

    A weighted total least squares fit: the plane's normal is the eigenvector with the smallest
    eigenvalue of the rays' weighted scatter matrix. The vertical counts as one more ray, with
    standard deviation `lean_std_rad`. It decides where the rays are too close together to tell
    the direction.

    Args:
        rays: (T, N, 3) rays to points on the axes; NaN where there is none.
        std_rad: (T, N) standard deviations of their angles; infinite for rays to ignore.
        up: (3,) unit vector of the vertical.
        lean_std_rad: Standard deviation of a stem's angle from the vertical.

    Returns:
        The axes in those planes that are closest to the vertical, and (T,) the standard deviation
        of each axis' angle in the image, in radians, from the inverse of the information matrix.
    """
    known = np.isfinite(rays).all(axis=2) & ~np.isnan(std_rad)
    rays = np.where(known[..., None], rays, up)
    directions = unit(rays)
    weight = np.where(known, 1 / std_rad**2, 0.0)
    scatter = np.matmul((directions * weight[..., None]).transpose(0, 2, 1), directions)
    scatter = scatter + np.outer(up, up) / lean_std_rad**2
    normals = np.linalg.eigh(scatter)[1][:, :, 0]
    axes = axes_in_planes(normals, up)
    in_plane = np.stack([axes.along, axes.away], 1)
    information = np.matmul(np.matmul(in_plane, scatter), in_plane.transpose(0, 2, 1))
    determinant = information[:, 0, 0] * information[:, 1, 1] - information[:, 0, 1] ** 2
    return axes, np.sqrt(information[:, 1, 1] / np.maximum(determinant, 1e-12))


def axes_in_planes(normals: Float, up: Float) -> StemAxes:
    """Coordinate systems of the axes that lie in given planes and are closest to the vertical.

    Args:
        normals: (T, 3) unit normals of planes through the camera, each holding one stem's axis.
        up: (3,) unit vector of the vertical.

    Returns:
        The systems; `across` is the plane's normal, turned to the right of an upright image.
    """
    along = unit(up - (normals @ up)[:, None] * normals)
    away = np.cross(along, normals)
    turn = np.where(away[:, 2:] < 0, -1.0, 1.0)
    return StemAxes(along, normals * turn, away * turn)


class StemView(NamedTuple):
    """Where viewing rays meet their stem, each array (T, N).

    Attributes:
        offset: sin(theta) / sin(delta), the lateral position on the stem: -1 and 1 at the edges.
        depth_ratio: Depth z of the front surface per metre from the camera to the axis; 0 where
            the ray misses the stem.
        depth_ratio_slope: Derivative of `depth_ratio` with respect to delta, per radian; 0 where
            the ray misses the stem.
        height_ratio: Height along the axis of the surface point, per metre from the camera to the
            axis.
    """

    offset: Float
    depth_ratio: Float
    depth_ratio_slope: Float
    height_ratio: Float


@dataclass(frozen=True, eq=False)
class Sections:
    """Cross-sections of T stems, scaled to 1 m from the camera to the axis.

    Attributes:
        axes: Coordinate systems of the stems.
        middle_rad: (T,) bearings of the stems' centres, see `StemAxes.bearing_and_slope`.
        half_rad: (T,) delta, half the angle between the two tangent rays.
        height_ratio: (T,) heights of the sections along the axes, per metre from the camera to
            the axis.
    """

    axes: StemAxes
    middle_rad: Float
    half_rad: Float
    height_ratio: Float

    @property
    def front_ratio(self) -> Float:
        """(T,) front range per metre from the camera to the axis: 1 - sin(delta)."""
        return np.asarray(1.0 - np.sin(self.half_rad))

    @cached_property
    def view_direction(self) -> Float:
        """(T, 3) unit vectors across the axis, from the camera to the stem's centre."""
        cos, sin = np.cos(self.middle_rad)[:, None], np.sin(self.middle_rad)[:, None]
        return np.asarray(cos * self.axes.away + sin * self.axes.across)

    @cached_property
    def directions(self) -> Float:
        """(T, 3, 3) unit vectors in rows: `view_direction`, `axes.across` and `axes.along`."""
        return np.stack([self.view_direction, self.axes.across, self.axes.along], 1)

    @cached_property
    def centre(self) -> Float:
        """(T, 3) centres of the sections, for 1 m from the camera to the axis."""
        return np.asarray(self.view_direction + self.height_ratio[:, None] * self.axes.along)

    def view(self, rays: Float) -> StemView:
        """Intersect viewing rays with the stems.

        Args:
            rays: (T, N, 3) rays with z = 1.
        """
        axes = self.axes
        cos, sin = np.cos(self.middle_rad)[:, None], np.sin(self.middle_rad)[:, None]
        ahead = _dot(rays, self.view_direction)
        aside = _dot(rays, cos * axes.across - sin * axes.away)
        squared_reach = ahead**2 + aside**2
        edge = np.sin(self.half_rad)[:, None]
        offset = aside / (edge * np.sqrt(squared_reach))
        inside = (np.abs(offset) < _MAX_OFFSET) & (ahead > 0)
        root = edge * np.sqrt(np.where(inside, (1 - offset**2) * squared_reach, 1.0))
        ratio = np.where(inside, (ahead - root) / squared_reach, 0.0)
        # Derivative of the root with respect to delta; the depth has the opposite sign.
        root_slope = edge * np.cos(self.half_rad)[:, None] / root
        slope = np.where(inside, -root_slope, 0.0)
        return StemView(offset, ratio, slope, _dot(rays, axes.along) * ratio)
