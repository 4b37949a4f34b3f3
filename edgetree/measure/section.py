"""The exact geometry of cylinders seen from near, on the planes across their axes.

Seen along its axis a cylinder is a circle, the camera a point, and every ray a direction in that
plane. The two rays that graze the stem's edges are tangents of the circle; with half the angle
between them, delta, and the distance d from camera to axis in the plane, the radius is
d sin(delta). A ray at angle theta from the middle meets the front of the circle at
d (cos(theta) - sqrt(sin²(delta) - sin²(theta))); in the middle that is the front range
rho = d (1 - sin(delta)), so the diameter is 2 rho sin(delta) / (1 - sin(delta)).

Everything is for T stems at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["AxisFrames", "Sections", "View", "axis_frames", "dot"]

Float = NDArray[np.floating[Any]]

# Where a ray grazes the stem the depth changes without bound; readings there are not used.
_GRAZING = 0.995


def dot(vectors: Float, axes: Float) -> Float:
    """(T, N) products of (T, N, 3) vectors with the (T, 3) axes of their stems."""
    return np.asarray(np.matmul(vectors, axes[..., None])[..., 0])


@dataclass(frozen=True, eq=False)
class AxisFrames:
    """Unit vectors (T, 3) at stems: `along` the axis upwards, `across` it to the right as seen,
    and `away` from the camera, both at right angles to the axis.
    """

    along: Float
    across: Float
    away: Float

    def tilted(self, tangent: Float) -> AxisFrames:
        """With each axis tilted away from the camera by an angle of this tangent (T,)."""
        tangent = tangent[:, None]
        length = np.hypot(1.0, tangent)
        return AxisFrames(
            (self.along + tangent * self.away) / length,
            self.across,
            (self.away - tangent * self.along) / length,
        )

    def bearing_rad(self, rays: Float) -> Float:
        """(T, N) angles of (T, N, 3) rays across the axis, from `away` towards `across`."""
        return np.arctan2(dot(rays, self.across), dot(rays, self.away))

    def slope(self, rays: Float) -> Float:
        """(T, N) how far (T, N, 3) rays climb along the axis per metre across it."""
        reach = np.hypot(dot(rays, self.across), dot(rays, self.away))
        return np.asarray(dot(rays, self.along) / reach)


def axis_frames(normals: Float, up: Float) -> AxisFrames:
    """The frames whose axes lie in the planes with `normals` (T, 3) through the camera, nearest
    to `up` (3,). `across` is the normal turned to the right of an upright camera's image.
    """
    along = up - (normals @ up)[:, None] * normals
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    away = np.cross(along, normals)
    turn = np.where(away[:, 2:] < 0, -1.0, 1.0)
    return AxisFrames(along, normals * turn, away * turn)


class View(NamedTuple):
    """How rays see their stem, each (T, N).

    `offset` is sin(theta) / sin(delta), -1 and 1 at the edges; `share` the depth z of the front
    per metre from the camera to the axis and `share_slope` its change per radian of delta, 0
    where the ray misses; `height` along the axis of the point of the bark, in the same share.
    """

    offset: Float
    share: Float
    share_slope: Float
    height: Float


@dataclass(frozen=True, eq=False)
class Sections:
    """Stems in the planes across their axes.

    Attributes:
        frames: the axes.
        middle_rad: (T,) bearing of the stem's middle.
        half_rad: (T,) delta, half the angle between the tangent rays.
        height: (T,) how far up the axis the section lies, per metre from the camera to the axis.
    """

    frames: AxisFrames
    middle_rad: Float
    half_rad: Float
    height: Float

    @property
    def front_share(self) -> Float:
        """(T,) front range per distance to the axis: 1 - sin(delta)."""
        return np.asarray(1.0 - np.sin(self.half_rad))

    @cached_property
    def facing(self) -> Float:
        """(T, 3) unit vectors across the axis, from the camera to the stem's middle."""
        cos, sin = np.cos(self.middle_rad)[:, None], np.sin(self.middle_rad)[:, None]
        return np.asarray(cos * self.frames.away + sin * self.frames.across)

    @cached_property
    def centre(self) -> Float:
        """(T, 3) axis points of the sections for 1 m from the camera to the axis."""
        return np.asarray(self.facing + self.height[:, None] * self.frames.along)

    def look(self, rays: Float) -> View:
        """How (T, N, 3) rays with z = 1 see the stems."""
        frames = self.frames
        cos, sin = np.cos(self.middle_rad)[:, None], np.sin(self.middle_rad)[:, None]
        ahead = dot(rays, cos * frames.away + sin * frames.across)
        aside = dot(rays, cos * frames.across - sin * frames.away)
        squared_reach = ahead**2 + aside**2
        edge = np.sin(self.half_rad)[:, None]
        offset = aside / (edge * np.sqrt(squared_reach))
        inside = (np.abs(offset) < _GRAZING) & (ahead > 0)
        behind = edge * np.sqrt(np.where(inside, (1 - offset**2) * squared_reach, 1.0))
        share = np.where(inside, (ahead - behind) / squared_reach, 0.0)
        bulge = edge * np.cos(self.half_rad)[:, None] / behind
        return View(offset, share, np.where(inside, -bulge, 0.0), dot(rays, frames.along) * share)
